"""Pieces of a scan that are left out: boxes, lassos, planes that leave the part; the file itself is never changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.files.ply_header import comments_of
from dqreg.files.write import write_cloud
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.sampling import sample_mesh
from dqreg.registration.problem.source import MESH_SAMPLES
from dqreg.studio.equivalent_commands import cleaned_name
from dqreg.studio.visit import Cut
from dqreg.studio.worker_cache import Place, cached

# Column of the times of points in the file that is written.
TIME_NAME = "timestamp"
# Points that are asked for a plane, and draws.
PLANE_POINTS, PLANE_DRAWS = 40_000, 600
# Share of the points that makes a plane worth a question.
MIN_PLANE_SHARE = 0.08
# Half the thickness of a plane: that many noises or spacings, whichever is more.
PLANE_SIGMAS, PLANE_SPACINGS = 4.0, 0.75
# A plane leaves the part where that share of its points extends that much farther than the part is large.
WIDTH_QUANTILE, LARGER_RATIO = 0.98, 1.05


def scan_cloud(scan: PointCloud | Mesh) -> PointCloud:
    """The points of a scan that cuts are about, with all that is known of them."""
    return sample_mesh(scan, MESH_SAMPLES, np.random.default_rng(0)) if isinstance(scan, Mesh) else scan


def scan_points(scan: PointCloud | Mesh) -> FloatArray:
    """The points of a scan that cuts are about."""
    return scan_cloud(scan).points


def kept_rows(points: FloatArray, cuts: tuple[Cut, ...]) -> BoolArray:
    """Which points no cut leaves out. Shapes: (n,)."""
    stays: BoolArray = np.ones(len(points), dtype=bool)
    for cut in cuts:
        inside = INSIDE[cut.kind](points, cut)
        stays = stays & (inside == cut.keep)
    return stays


def _in_box(points: FloatArray, cut: Cut) -> BoolArray:
    low, high = np.minimum(cut.low, cut.high), np.maximum(cut.low, cut.high)
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _in_lasso(points: FloatArray, cut: Cut) -> BoolArray:
    if len(cut.polygon) < 3:
        return np.zeros(len(points), dtype=bool)
    from matplotlib.path import Path as Outline

    inside: BoolArray = Outline(np.array(cut.polygon)).contains_points(points @ np.array([cut.right, cut.up]).T)
    return inside


def _at_plane(points: FloatArray, cut: Cut) -> BoolArray:
    normal = np.array(cut.normal)
    off: BoolArray = np.abs(points @ (normal / np.linalg.norm(normal)) - cut.offset) <= cut.half
    return off


INSIDE = {"box": _in_box, "lasso": _in_lasso, "plane": _at_plane}


def cleaned_file(place: Place) -> Path:
    """The file that is registered: the scan as it was given, or what the cuts leave of it as a file beside it."""
    cuts, name = place.visit.cuts, cleaned_name(place.visit)
    if name is None:
        return place.scan_path
    scan = scan_cloud(place.scan())
    stays = kept_rows(scan.points, cuts)
    if np.count_nonzero(stays) < 3:
        raise InputError("the cuts leave nothing of the scan: undo the last one")
    path = place.folder / name

    def make() -> Path:
        kept = scan._taken(stays)
        times = {} if kept.times is None else {TIME_NAME: kept.times}
        write_cloud(path, kept.points, kept.normals, fields=times, comments=comments_of(kept.units, kept.viewpoint))
        return path

    cached("cleaned", [str(path), *place.scan_key, cuts], make)
    # It was written once; whoever took it away meanwhile gets it again.
    return path if path.is_file() else make()


def leaving_plane(place: Place, spacing: float, noise: float) -> tuple[Cut, int] | None:
    """A plane of the scan that extends beyond the part, and its points; None where there is none worth a question."""
    points = scan_points(place.scan())
    points = points[kept_rows(points, place.visit.cuts)]
    half = max(PLANE_SIGMAS * noise, PLANE_SPACINGS * spacing)
    if len(points) < 100 or half <= 0.0:
        return None
    middle = np.median(points, axis=0)
    cut = cached("plane", [*place.scan_key, place.visit.cuts], lambda: _largest_plane(points - middle, half))
    normal = np.array(cut.normal)
    cut = Cut("plane", normal=cut.normal, offset=cut.offset + float(normal @ middle), half=half)
    on = _at_plane(points, cut)
    part = place.part()
    size = float(np.linalg.norm(np.ptp(part.vertices if isinstance(part, Mesh) else part.points, axis=0)))
    extent = _width(points[on]) * place.scale()
    if np.count_nonzero(on) < MIN_PLANE_SHARE * len(points) or extent < LARGER_RATIO * size:
        return None
    return cut, int(np.count_nonzero(on))


def _width(points: FloatArray) -> float:
    """Diameter of nearly all points about their middle, whichever way they are turned."""
    if not len(points):
        return 0.0
    return 2.0 * float(np.quantile(np.linalg.norm(points - np.median(points, axis=0), axis=1), WIDTH_QUANTILE))


def _largest_plane(points: FloatArray, half: float) -> Cut:
    step = -(-len(points) // PLANE_POINTS)
    open3d = load_open3d()
    open3d.utility.random.seed(0)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points[::step]))
    (a, b, c, d), _ = cloud.segment_plane(distance_threshold=half, ransac_n=3, num_iterations=PLANE_DRAWS)
    length = float(np.linalg.norm([a, b, c]))
    return Cut("plane", normal=(a / length, b / length, c / length), offset=-d / length, half=half)
