"""All kernels at once, on next to no data: what `dqreg doctor --compile` does when an image is built."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg.kernels.clouds.components import components
from dqreg.kernels.clouds.one_sided_neighbourhoods import off_centre_rows
from dqreg.kernels.clouds.plane_fits import fit_plane_rows
from dqreg.kernels.clouds.plane_growth import measure_pieces, take_pieces
from dqreg.kernels.clouds.rims import line_rows, one_sided_rows
from dqreg.kernels.compiling import compile_clouds, second_process
from dqreg.kernels.compiling.cache import keep_beside_package
from dqreg.kernels.compiling.gc_pause import gc_paused
from dqreg.kernels.evidence.both_sides import motion_shares
from dqreg.kernels.evidence.motion_sums import COLUMNS as MOTION_SUMS
from dqreg.kernels.evidence.motion_sums import TOTALS, motion_sums
from dqreg.kernels.evidence.neighbour_differences import neighbour_differences
from dqreg.kernels.evidence.patch_pairs import best_range, binned_agreements, covariance_sums, nearest_others
from dqreg.kernels.evidence.patch_sums import BESIDE, joined_sums, patch_means, patch_sums
from dqreg.kernels.evidence.planar_boundary import in_plane_sq_distances, interior_rows, near_fractions
from dqreg.kernels.evidence.plane_gaps import COLUMNS as OF_GAPS
from dqreg.kernels.evidence.plane_gaps import enclosed_gaps, hold_cells
from dqreg.kernels.evidence.plane_rows import plane_row_columns, strain_row_columns
from dqreg.kernels.evidence.ray_pixels import COUNTS as OF_RAYS
from dqreg.kernels.evidence.ray_pixels import fill_pixels, rays_met
from dqreg.kernels.meshes.areas_by_direction import areas_by_direction
from dqreg.kernels.meshes.corner_lists import list_corners, weld
from dqreg.kernels.meshes.creases import COLUMNS as OF_CREASES
from dqreg.kernels.meshes.creases import near_creases
from dqreg.kernels.meshes.duplicate_triangles import first_duplicates, first_equal
from dqreg.kernels.meshes.face_fans import neighbours_of_faces, normals_of_corners
from dqreg.kernels.meshes.mesh_faces import ENDS, MOMENTS, face_columns, solid_faces, surface_moments
from dqreg.kernels.meshes.mesh_sides import number_sides
from dqreg.kernels.meshes.pseudo_normals import add_scaled_rows, corner_angles, pseudo_normals_at, smooth_normals_at
from dqreg.kernels.meshes.side_parity import number_nodes, sums_of_sides
from dqreg.kernels.order.row_scatter import scatter_rows
from dqreg.kernels.search.pair_differences import pair_differences
from dqreg.kernels.steps.disc_pairs import disc_pair_sums
from dqreg.kernels.steps.displaced_rows import displaced_rows, followed_share
from dqreg.kernels.steps.face_scatter import (
    face_precisions,
    face_sums,
    orientation_cells,
    square_heights,
    times_precisions,
)
from dqreg.kernels.steps.largest_eigenvectors import largest_eigenvectors
from dqreg.kernels.steps.plane_elimination import eliminate_planes
from dqreg.kernels.steps.points_on_faces import points_on_faces
from dqreg.kernels.steps.pose_forms import NUMBERS, SUMS, form_of_sums, least_cost_pose
from dqreg.kernels.steps.systematic_rows import systematic_rows
from dqreg.kernels.steps.weighing import SUMS as WEIGHED
from dqreg.kernels.steps.weighing import place_rows, slide_rows, weigh_rows
from dqreg.kernels.steps.weighted_planes import (
    COLUMNS,
    PAIR_COLUMNS,
    STEP,
    pair_moments,
    plane_sums,
    short_twist,
    step_sums,
)
from dqreg.kernels.trees.follow_rows import follow_rows, look_up_rows
from dqreg.kernels.trees.near_rows import near_rows
from dqreg.kernels.trees.neighbour_counts import rows_with_neighbours
from dqreg.kernels.trees.point_tree import LEAF_POINTS, PointTree
from dqreg.kernels.trees.triangle_tree import TriangleTree

FLAT, ONE = np.eye(3), np.zeros(3)
NOTHING = np.zeros(0)
CORNERS = np.eye(3)[None] + np.arange(2.0)[:, None, None]
FIRST = np.zeros(1, dtype=np.int64)


def compile_all(*, backwards: bool = False) -> None:
    """Compile every kernel for the arrays that it is called with, and keep the code."""
    with gc_paused():
        for step in STEPS[::-1] if backwards else STEPS:
            step()


def compile_for_all_users() -> None:
    """The same with a second process, where there is a core for it; the code is kept for every user of the package."""
    keep_beside_package()
    other = second_process.start()
    try:
        compile_all()
    finally:
        if other is not None:
            other.terminate()
            other.wait()


def _faces() -> None:
    first_duplicates(CORNERS)
    first_equal(np.zeros(1, dtype=np.uint64))
    tree = TriangleTree.of(CORNERS, np.ones((2, 3)))
    tree.closest(np.zeros((1, 3)))
    tree.closest_facing(np.zeros((1, 3)), np.ones((1, 3)), 0.0, 1.0)
    tree.distances(FLAT[None], ONE[None], CORNERS[0], 1.0)


def _points() -> None:
    tree = PointTree.of(CORNERS[0])
    rows, _ = tree.nearest(CORNERS[0], 3)
    tree.nearest_of(np.arange(3), 1)
    fit_plane_rows(0, 0, CORNERS[0], rows, np.zeros((1, 3)), np.zeros(1), np.zeros(1))


def _features() -> None:
    rows, none = np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.bool_)
    rows_with_neighbours(0, 0, np.zeros((1, 6)), FLAT, LEAF_POINTS, 1, 1.0, none)
    off_centre_rows(0, 0, FLAT, rows, FLAT, FLAT, 1.0, none, np.zeros((0, 3)))


def _steps() -> None:
    least_cost_pose(np.eye(NUMBERS), np.zeros((2, 3)), np.eye(4), 1, *(1.0,) * 4, np.eye(4))
    form_of_sums(np.zeros((1, SUMS)), np.zeros((2, 3)), np.zeros((NUMBERS, NUMBERS)))


def _weights() -> None:
    rows, ones = np.eye(3), np.ones(3)
    limits, weighed = np.ones(5), np.zeros((1, WEIGHED))
    weigh_rows(0, 3, ones, *(rows,) * 3, *(NOTHING,) * 3, limits, 3, np.zeros(3), weighed)
    plane_row_columns(0, 3, rows, rows, ones, 1.0, np.zeros((6, 3)))
    strain_row_columns(0, 3, rows, rows, rows, 1.0, np.zeros((9, 3)))
    nearest, numbers = np.zeros((3, 2), dtype=np.int32), np.zeros(3, dtype=np.int64)
    slide_rows(0, 3, rows, np.eye(4), *(rows,) * 3, numbers, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3))
    follow_rows(0, 3, rows, rows, nearest, ones, rows, 1.0, numbers, np.zeros(3), np.zeros(3))
    look_up_rows(0, 3, numbers, rows, rows, ones, numbers, np.eye(3), np.eye(3), np.zeros(3), numbers.copy())
    place_rows(0, 3, rows, np.eye(4), rows, rows, np.zeros((3, 3)), np.zeros(3))
    plane_sums(0, 3, rows, rows, rows, ones, np.zeros((2, 3)), 3, np.zeros((1, COLUMNS)))
    step_sums(0, 3, rows, rows, rows, ones, ONE, 3, np.zeros((1, STEP)))
    short_twist(np.zeros((1, STEP)), 1e-9, np.zeros(6))
    pair_moments(0, 3, rows, np.eye(4), rows, rows, ones, NOTHING, ones, 3, np.zeros((1, PAIR_COLUMNS)))
    faces, part, sums, known = (
        np.zeros(3, dtype=np.int64),
        np.zeros(0, dtype=np.uint8),
        np.zeros((1, 2, 2)),
        np.ones((1, 2)),
    )
    square_heights(0, 3, rows, rows, rows, ones, NOTHING, np.zeros(3))
    near, found = np.zeros(3, dtype=bool), np.zeros((1, OF_CREASES))
    near_creases(0, 3, rows, rows, faces, ones, CORNERS, FLAT, FLAT, ones, 1.0, 1.0, 1.0, 3, near, found)
    face_sums(ones, ones, faces, part, sums, FIRST)
    orientation_cells(0, 3, rows, 1, np.zeros(3, dtype=np.int64))
    face_precisions(sums, FIRST, rows, 1, np.zeros((8, 2)), 1.0, 1.0, 1.0, known)
    times_precisions(0, 3, faces, part, known, np.ones(3))


def _dense_scans() -> None:
    rows = np.eye(3)
    systematic_rows(NOTHING, FIRST[:0], np.zeros(0, np.bool_), FIRST)
    on = np.zeros((1, 3), dtype=bool)
    lengths = 1.0, 1.0, 1.0, 1.0
    counts, parts = np.zeros((1, 1), dtype=np.int64), np.zeros(3, dtype=np.uint8)
    places = on, counts, np.zeros((1, 1, 3)), np.zeros((1, 1))
    points_on_faces(0, 1, rows, 3, CORNERS, FIRST, rows, np.eye(4), *lengths, parts, *places)


def _shared_noise() -> None:
    nearest_others(FLAT, np.zeros(3))
    binned_agreements(FLAT, FLAT, ONE, 1.0, np.zeros(2), np.zeros(2))
    patch_sums(0, 0, *(FLAT,) * 3, *(ONE,) * 2, FIRST, np.zeros((1, 3 + BESIDE)))
    joined_sums(FIRST, np.zeros((1, 2)), FIRST, np.zeros((1, 1)))
    patch_means(np.zeros((1, BESIDE)), 0.0, 1, *np.zeros((2, 1, 3)), *np.zeros((2, 1)))
    best_range(ONE, np.zeros(2), np.zeros(2), 1.0, 1.0)
    covariance_sums(FLAT, FLAT, 1.0, 1.0, *np.zeros((4, 3, 1)))


def _patches() -> None:
    displaced_rows(ONE, *(FLAT,) * 3, 1.0, 1.0, FIRST, FLAT)
    followed_share(*(FLAT,) * 4, 1.0, 1.0)
    neighbour_differences(ONE, FLAT, FIRST[:0, None], 1.0, NOTHING, ONE)
    motion_sums(0, 0, *(FLAT,) * 4, *(ONE,) * 3, 1.0, FIRST, 1, np.zeros((1, MOTION_SUMS)), np.zeros((1, TOTALS)))
    motion_shares(0, 0, *(FLAT,) * 3, np.eye(6), ONE, NOTHING, ONE, 1.0, 1, np.zeros((1, 2, 6)))


def _common_planes() -> None:
    near, none, sizes = np.zeros((0, 3), dtype=np.int64), FIRST[:0].copy(), np.zeros(0, dtype=np.int64)
    measure_pieces(0, 0, FLAT, FLAT, none, near, 1.0, True, sizes, np.zeros(0))
    take_pieces(FLAT, FLAT, none, none, near, 1.0, True, none, sizes)
    table, blocks = np.zeros((1, 1), dtype=np.int64), np.zeros((1, 6, 6))
    eliminate_planes(FIRST.copy(), none, np.zeros((0, 4, 4)), 1.0, table, blocks, np.zeros((0, 6)))


def _rims() -> None:
    few, none = np.zeros((0, 2), dtype=np.int32), np.zeros(0, dtype=np.bool_)
    one_sided_rows(0, 0, FLAT, FIRST[:0], few, NOTHING, FLAT, 0.25, 0.15, none)
    line_rows(0, 0, FLAT, few, 0.15, none)
    components(1, FIRST[:0], FIRST[:0])
    near_rows(FLAT, FIRST[:0], FLAT, FIRST[:0], LEAF_POINTS, 1.0, none)
    near_fractions(0, 0, FIRST[:0], few, 1, none, NOTHING)
    in_plane_sq_distances(FLAT, ONE, FIRST, FIRST[:0], 1, 0, NOTHING)
    flat = FIRST[:0], np.zeros((0, 2)), FIRST[:0], FIRST[:0]
    interior_rows(0, 0, *flat, FLAT, FIRST[:0], few, 1, 1, 1.0, -0.5, none)
    image = 1.0, FIRST, FIRST + 1, ONE.copy(), ONE.copy()
    fill_pixels(np.zeros((0, 3)), *image, FIRST[:0])
    rays_met(0, 0, FLAT, CORNERS, FLAT, *image, 0.0, 0.0, 1.0, np.zeros((1, OF_RAYS), dtype=np.int64))
    cells = np.zeros((1, 1), dtype=np.bool_)
    hold_cells(flat[1], ONE[:2].copy(), 1.0, cells)
    enclosed_gaps(
        cells, cells, 1, np.zeros((1, 1), dtype=np.int32), FIRST.copy(), np.zeros((1, OF_GAPS), dtype=np.int64)
    )


def _meshes() -> None:
    faces, none = np.arange(3)[None], np.zeros(1, dtype=bool)
    solid_faces(0, 1, FLAT, faces, 1, 0.0, none, np.zeros((1, ENDS)))
    face_columns(0, 1, FLAT, faces, CORNERS[0].copy(), np.zeros(1))


def _sides() -> None:
    faces, none = np.arange(3)[None], np.zeros(1, dtype=bool)
    number_sides(faces, 3, none, faces.copy(), faces.copy(), faces.copy())
    numbers, lists = np.zeros(3, dtype=np.uint64), np.zeros((2, 3), dtype=np.int32)
    number_nodes(0, 3, FLAT, 1.0, numbers)
    sums_of_sides(0, 1, faces, numbers, 1, np.zeros((1, 3), dtype=np.uint64))
    weld(numbers, np.zeros(8, dtype=np.int32), lists[0])
    list_corners(faces, lists[0], heads := np.full((3, 2), -1, dtype=np.int32), lists[1])
    met = faces, lists[0], heads, lists[1]
    normals_of_corners(0, 0, FIRST, *met, CORNERS, FLAT, 0.5, 0.5, CORNERS)
    neighbours_of_faces(0, 0, FIRST, *met, FLAT, 0.5, faces.copy(), CORNERS, none)
    areas_by_direction(FLAT, ONE, 1, np.zeros(8, dtype=np.int64), np.zeros(8))
    surface_moments(0, 1, CORNERS, ONE, ONE, 1, np.zeros((1, MOMENTS)))
    corner_angles(0, 0, CORNERS, np.eye(3))
    add_scaled_rows(np.eye(3), 1, NOTHING, FIRST[:0], np.eye(3))


def _signs() -> None:
    flat = np.eye(3)
    smooth_normals_at(0, 0, flat, FIRST, np.zeros(1, dtype=np.bool_), CORNERS, CORNERS, flat)
    scatter_rows(FIRST[:0], NOTHING, flat, FIRST, NOTHING, flat, FIRST)
    pseudo_normals_at(0, 0, flat, flat, FIRST, CORNERS, CORNERS, FIRST[None], flat, 1e-6, 1.0, flat, ONE)


def _pairs() -> None:
    places, counts, none = np.zeros((1, 3)), np.zeros(1, dtype=np.int32), np.zeros(0, dtype=np.bool_)
    pair_differences(places, places, np.ones(4), 1, counts, none, places, FIRST[:0])
    disc_pair_sums(0, 0, *(FLAT,) * 5, *(ONE,) * 3, np.zeros((2, 3)), 1.0, 1.0, 1, np.zeros((1, SUMS)))


def _many_problems() -> None:
    largest_eigenvectors(0, 1, np.eye(3)[:, :, None].copy(), np.zeros((3, 1)), np.zeros((4, 1)))


# The order in which a first registration to a part needs them, which a second process goes through from the end. What
# such a registration does not need stands where the two are to meet: neither comes to it before all else is done.
STEPS: tuple[Callable[[], None], ...] = (
    _meshes,
    _sides,
    compile_clouds.order_points,
    _faces,
    compile_clouds.fit_neighbourhoods,
    compile_clouds.measure_steps,
    _common_planes,
    _many_problems,
    compile_clouds.keep_maps,
    compile_clouds.look_along_rays,
    compile_clouds.step_between_clouds,
    _rims,
    _pairs,
    _shared_noise,
    _signs,
    _dense_scans,
    _points,
    _features,
    compile_clouds.search_poses,
    _patches,
    _weights,
    _steps,
)
