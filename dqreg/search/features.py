"""Oriented points of a scan and of a target, rare directions as likely as common ones.

There are two kinds. On a *face* the direction is the normal. At an *edge*, where a face ends, it is the direction in
the face that leads off it: only edges constrain a thin plate in its own plane, and a scan of it has no points on the
narrow walls. On a mesh they are its sharp and open edges, known exactly; on a cloud they are the points whose
neighbours all lie on one side.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Mesh, PointCloud, Scan, Surface, sample_mesh
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NORMAL_NEIGHBOURS, fit_planes, fit_planes_among, sample_rows
from dqreg.search.oriented_points import OrientedPoints

# Oriented points of a scan, and points among which their neighbours are sought.
SCAN_POINTS, NEIGHBOUR_POINTS = 4_000, 20_000
# Neighbours of a normal in noisy scans, and the error of a normal that calls for them.
NOISY_NEIGHBOURS = 64
NOISY_NORMAL_RAD = 0.08
# A mean of neighbours that far off, in their own spread: half of the neighbourhood is missing (a straight edge has
# 0.6).
ONE_SIDED_SPREADS = 0.42
# Fewer edge points than this are ignored.
FEWEST_EDGES = 20
# Faces that meet at a larger angle meet in a sharp edge.
SHARP_RAD = np.deg2rad(30.0)
# Samples of the sharp edges.
EDGE_SAMPLES = 6_000
# A point whose so-manieth neighbour is so many times farther off than the median is an outlier.
OUTLIER_NEIGHBOURS, OUTLIER_RATIO = 8, 3.0
# Plane residuals beyond this fraction of the size plus this many medians belong to outliers and corners.
RESIDUAL_DIAGONALS, RESIDUAL_MEDIANS = 4e-3, 5.0


def scan_features(scan: Scan, size: float) -> OrientedPoints:
    """Points of a scan on faces, then those at edges."""
    cloud, tree = _without_outliers(scan.thinned(NEIGHBOUR_POINTS).points)
    rows = sample_rows(len(cloud), SCAN_POINTS)
    points = cloud[rows]
    around, _ = tree.nearest_to(rows, NORMAL_NEIGHBOURS)
    fits = fit_planes_among(cloud, around)
    if not np.isfinite(fits.variances).any():
        # Three points, or points on lines: no plane anywhere, so that no pair has a key.
        return dataclasses.replace(OrientedPoints.on_faces(points), weights=np.zeros(len(points)))
    if np.nanmedian(np.sqrt(fits.variances)) > NOISY_NORMAL_RAD:
        fits = fit_planes(tree, cloud, points, NOISY_NEIGHBOURS)
    normals, residuals = np.nan_to_num(fits.normals), fits.residuals
    limit = RESIDUAL_DIAGONALS * size + RESIDUAL_MEDIANS * float(np.nanmedian(residuals))
    sound = normals.any(axis=1) & ~(residuals > limit)
    faces = np.where(sound, rarity(normals), 0.0)
    at_edge, outwards = edge_points(cloud, around, points, normals)
    at_edge &= sound
    if np.count_nonzero(at_edge) < FEWEST_EDGES:
        at_edge[:] = False
    edge_weights = np.full(np.count_nonzero(at_edge), 0.5 * faces.sum() / max(np.count_nonzero(at_edge), 1))
    return OrientedPoints(
        np.concatenate([points, points[at_edge]]),
        np.concatenate([normals, outwards[at_edge]]),
        np.arange(len(points) + len(edge_weights)) >= len(points),
        np.concatenate([faces, edge_weights]),
    )


def _without_outliers(points: FloatArray) -> tuple[FloatArray, NeighbourTree]:
    """The points, in Morton order, that have neighbours about as near as most have, and a tree of them."""
    tree = NeighbourTree(points, in_order=True)
    rows = sample_rows(len(points), SCAN_POINTS // 2)
    farthest = tree.nearest_to(rows, OUTLIER_NEIGHBOURS)[1][:, -1]
    near = tree.have_near(OUTLIER_NEIGHBOURS, OUTLIER_RATIO * float(np.median(farthest)))
    return (points, tree) if near.all() else (points[near], NeighbourTree(points[near], in_order=True))


def even_points(target: PointCloud | Mesh, surface: Surface, count: int) -> OrientedPoints:
    """Points evenly over a target, in Morton order, with their normals."""
    points = target.points if isinstance(target, PointCloud) else sample_mesh(target, count, _rng()).points
    points = points[morton_order(points)][sample_rows(len(points), count)]
    return OrientedPoints.on_faces(points, surface.closest(points).normals)


def target_features(target: PointCloud | Mesh, even: OrientedPoints, count: int) -> tuple[OrientedPoints, FloatArray]:
    """So many points of a target on faces, then at edges, of evenly spread ones; and all points at edges, (m, 3)."""
    rng = _rng()
    points, normals = even.points, even.directions
    if isinstance(target, Mesh):
        edges, outwards = _sharp_edges(target, rng)
    else:
        around, _ = NeighbourTree(points).nearest(points, NORMAL_NEIGHBOURS)
        at_edge, outwards = edge_points(points, around, points, normals)
        edges, outwards = points[at_edge], outwards[at_edge]
    if len(edges) < FEWEST_EDGES:
        edges, outwards = np.zeros((0, 3)), np.zeros((0, 3))
    edge_rows = rng.choice(len(edges), size=min(len(edges), count // 4), replace=False)
    weights = np.where(normals.any(axis=1), rarity(normals), 0.0)
    rare = np.zeros(0, dtype=np.int64)
    if np.count_nonzero(weights) >= count // 4:
        rare = rng.choice(len(points), size=count // 4, replace=False, p=weights / weights.sum())
    spread = sample_rows(len(points), count - count // 4 - len(edge_rows))
    rows = np.union1d(spread, rare)
    rows = rows[weights[rows] > 0.0]
    features = OrientedPoints(
        np.concatenate([points[rows], edges[edge_rows]]),
        np.concatenate([normals[rows], outwards[edge_rows]]),
        np.arange(len(rows) + len(edge_rows)) >= len(rows),
        np.ones(len(rows) + len(edge_rows)),
    )
    return features, edges


def _rng() -> np.random.Generator:
    # The same target gives the same points.
    return np.random.default_rng(0)


def rarity(normals: FloatArray) -> FloatArray:
    """Weights that give every direction, whatever its sign, the root of its fraction of the points."""
    main = np.abs(normals).argmax(axis=1)
    rows = np.arange(len(normals))
    turned = normals * np.where(normals[rows, main] < 0.0, -1.0, 1.0)[:, None]
    others = np.stack([turned[rows, (main + 1) % 3], turned[rows, (main + 2) % 3]], axis=1)
    cells = np.clip((2.5 * (others + 0.8)).astype(np.int64), 0, 3)
    bins = (main * 4 + cells[:, 0]) * 4 + cells[:, 1]
    weights: FloatArray = 1.0 / np.sqrt(np.bincount(bins, minlength=48)[bins])
    return weights


def edge_points(
    cloud: FloatArray, around: IntArray, at: FloatArray, normals: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """Where a sampled face ends, and the direction that leads off it, from the neighbours of its points, (n, k)."""
    from dqreg.kernels.clouds.one_sided_neighbourhoods import off_centre_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    found, outwards = np.zeros(len(at), dtype=bool), np.zeros((len(at), 3))
    asked = as_plain(cloud), around, as_plain(at), as_plain(normals), ONE_SIDED_SPREADS
    over_chunks(off_centre_rows, len(at), *asked, found, outwards)
    return found, outwards


def _sharp_edges(mesh: Mesh, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Samples along sharp and open edges, and for each the direction off one of its faces."""
    faces, sides = np.divmod(np.arange(3 * len(mesh.faces)), 3)
    beyond = mesh.face_neighbours.reshape(-1)
    cosines = np.einsum("ij,ij->i", mesh.face_normals[faces], mesh.face_normals[beyond])
    # Each sharp edge is met twice, once from either face.
    sharp = np.flatnonzero((cosines < np.cos(SHARP_RAD)) | (beyond == faces))
    if not len(sharp):
        return np.zeros((0, 3)), np.zeros((0, 3))
    start = mesh.corners[faces[sharp], sides[sharp]]
    along = mesh.corners[faces[sharp], (sides[sharp] + 1) % 3] - start
    length = np.linalg.norm(along, axis=1)
    rows = rng.choice(len(sharp), size=EDGE_SAMPLES, p=length / length.sum())
    points = start[rows] + rng.random(len(rows))[:, None] * along[rows]
    outwards = np.cross(along[rows], mesh.face_normals[faces[sharp][rows]]) / length[rows][:, None]
    return points, outwards
