"""Signed distances of many points: closest place, side and the way back to the order of the scan, a range at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, IntArray, shifted
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_normals import PseudoNormals
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.spacing import measure_spacing
from dqreg.geometry.surface import Surface
from dqreg.inspection.deviations.facing_sides import Facing

# Points of a range: what is known of them stays in a core's cache from the search to the sign.
CHUNK_POINTS = 1 << 13
# Points of a cloud's range: its tree has threads of its own.
CLOUD_CHUNK_POINTS = 1 << 18
# Points after which progress is told.
PROGRESS_POINTS = 1 << 20
# Radius of the disc that a point of a target cloud stands for, in spacings of that cloud: discs overlap, no holes.
DISC_SPACINGS = 3.0

Progress = Callable[[int, int], object]
# Values, closest places, and faces or points that are closest.
Answer = tuple[FloatArray, FloatArray, IntArray]


def signed_distances(
    points: FloatArray,
    geometry: Mesh | PointCloud,
    surface: Surface,
    signed: bool,
    progress: Progress | None = None,
    facing: Facing | None = None,
    within: float = np.inf,
) -> Answer:
    """Distance of every point from a target, negative inside where ``signed``; see `measure_deviations`.

    Where it is known which way the scan looks, ``facing``, a signed mesh is asked for faces that look there and are
    nearer than ``within``.
    """
    from dqreg.kernels.order.row_scatter import scatter_rows
    from dqreg.kernels.threads import over_chunks

    count, is_mesh = len(points), isinstance(geometry, Mesh)
    if isinstance(geometry, Mesh):
        ask = _on_mesh(geometry, surface, signed, facing if signed else None, within)
    else:
        ask = _on_cloud(geometry, surface, signed)
    values, closest, faces = np.zeros(count), np.zeros((count, 3)), np.zeros(count, dtype=np.int64)
    # In Morton order queries are several times as fast: each begins at the face of the one before it. At the end it is
    # one of the large arrays.
    order = morton_order(points).astype(np.int32 if count < 1 << 31 else np.int64)

    def measure(first: int, last: int, told: int = 0) -> None:
        rows = order[told + first : told + last].astype(np.int64)
        scatter_rows(rows, *ask(np.take(points, rows, axis=0), rows), values, closest, faces)

    for told in range(0, count, PROGRESS_POINTS):
        some = min(PROGRESS_POINTS, count - told)
        if is_mesh:
            over_chunks(measure, some, told, chunk=CHUNK_POINTS)
        else:
            for first in range(0, some, CLOUD_CHUNK_POINTS):
                measure(first, min(first + CLOUD_CHUNK_POINTS, some), told)
        if progress is not None:
            progress(told + some, count)
    return values, closest, faces


def moved(points: FloatArray, offset: FloatArray, out: FloatArray) -> FloatArray:
    """Points moved by one offset, (3,), written to ``out``, which may be the same array."""
    from dqreg.kernels.threads import over_chunks

    def move(first: int, last: int) -> None:
        out[first:last] = shifted(points[first:last], offset)

    over_chunks(move, len(points), chunk=CHUNK_POINTS)
    return out


def _on_mesh(
    mesh: Mesh, surface: Surface, signed: bool, facing: Facing | None, within: float
) -> Callable[[FloatArray, IntArray], Answer]:
    # Made before threads ask for it.
    pseudo = PseudoNormals.of(mesh) if signed else None
    outside = -1.0 if signed and mesh.inward_bodies[0] else 1.0

    def ask(points: FloatArray, rows: IntArray) -> Answer:
        found = surface.closest(points) if facing is None else facing.closest(points, rows, surface, outside, within)
        values = found.distances if pseudo is None else pseudo.signed(points, found, outside)
        return values, found.points, found.elements

    return ask


def _on_cloud(cloud: PointCloud, surface: Surface, signed: bool) -> Callable[[FloatArray, IntArray], Answer]:
    radius = DISC_SPACINGS * measure_spacing(NeighbourTree(cloud.points), cloud.points)

    def ask(points: FloatArray, _: IntArray) -> Answer:
        found = surface.closest(points)
        offsets = points - found.points
        height = np.einsum("ij,ij->i", offsets, found.normals)
        across = offsets - height[:, None] * found.normals
        length = np.linalg.norm(across, axis=1)
        # A zero normal has no plane; there the disc is the point itself.
        room = np.where(found.normals.any(axis=1), radius, 0.0)
        share = np.minimum(np.divide(room, length, out=np.ones_like(length), where=length > 0.0), 1.0)
        feet = found.points + share[:, None] * across
        values = np.linalg.norm(points - feet, axis=1)
        return np.where(height < 0.0, -values, values) if signed else values, feet, found.elements

    return ask
