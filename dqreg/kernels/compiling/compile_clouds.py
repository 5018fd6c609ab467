"""Kernels of clouds, of the odometry and of the global search: what `compile_all` compiles of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg.kernels.cells.cell_blocks import cell_blocks, hand_down, joined_cells
from dqreg.kernels.cells.cell_planes import cell_planes
from dqreg.kernels.cells.cell_smoothing import held_by_sure, plane_columns, share_of_lined, smoothed_means
from dqreg.kernels.cells.grid_cells import cells_of_points
from dqreg.kernels.cells.voxel_rows import VoxelSums, first_of_voxels, measured_rows, one_of_voxels
from dqreg.kernels.clouds.edge_planes import edge_plane_rows, with_others_rows
from dqreg.kernels.clouds.fitted_normals import normal_variances, rough_rows
from dqreg.kernels.clouds.lined_runs import lined_runs
from dqreg.kernels.clouds.majority_planes import majority_plane_rows
from dqreg.kernels.clouds.point_spread import rms_motion, spread_of
from dqreg.kernels.clouds.quadric_fits import quadric_residual_rows
from dqreg.kernels.clouds.rims import known_rims
from dqreg.kernels.clouds.spreads import scatter_of_most
from dqreg.kernels.evidence.depth_pixels import count_before, count_behind, directions_from, fill_nearest, least_around
from dqreg.kernels.maps.cell_matches import leave_out_beams, planes_in_cells
from dqreg.kernels.maps.shift_counts import count_at_shifts, count_on_runs, runs_around
from dqreg.kernels.maps.swept_rows import swept_rows
from dqreg.kernels.maps.voxel_blocks import put_blocks
from dqreg.kernels.maps.voxel_nearest import distances_in_voxels
from dqreg.kernels.maps.voxel_planes import closest_in_voxels
from dqreg.kernels.maps.voxel_points import CELLS, SUMS, admit_points
from dqreg.kernels.order.morton import count_cells, filled_cells, morton_cells, new_places, sorted_rows, take_points
from dqreg.kernels.order.split_sort import split_sorted_rows
from dqreg.kernels.search.coarse_to_fine_nearest import nearest_at_corners, nearest_from_coarser, planes_at_nodes
from dqreg.kernels.search.many_poses import distinct_rows, log_likelihoods, mean_gains, poses_within
from dqreg.kernels.search.nearest_at_nodes import nearest_at_nodes
from dqreg.kernels.search.pair_keys import all_pair_keys, key_starts, order_of_keys, pair_keys
from dqreg.kernels.search.pair_poses import pair_poses
from dqreg.kernels.search.pose_steps import add_plane_steps, grid_places, grid_planes, take_damped_steps
from dqreg.kernels.search.weighted_draws import drawn_rows
from dqreg.kernels.steps.mixture_fits import fit_mixture
from dqreg.kernels.steps.plane_pass import Lowering, Stepping, bend_of, lower_weights, plane_pass
from dqreg.kernels.steps.plane_steps import FIGURES, step_on_planes, weigh_by_roughness
from dqreg.kernels.steps.sweep_steps import step_on_planes_of_sweep
from dqreg.kernels.steps.weighing import SUMS as WEIGHED
from dqreg.kernels.steps.weighing import move_rows
from dqreg.kernels.trees.close_points import close_points, facing_matches
from dqreg.kernels.trees.follow_rows import follow_in_tree
from dqreg.kernels.trees.point_tree import LEAF_POINTS, PointTree

CORNERS = np.eye(3)
FLAT, ONE = np.eye(3), np.zeros(3)
NOTHING = np.zeros(0)
FIRST = np.zeros(1, dtype=np.int64)
SHAPE = np.ones(3, dtype=np.int64)


def order_points() -> None:
    """Morton order and cells."""
    codes, move = np.zeros(2, dtype=np.uint64), np.array([1.0, 0.0, 0.0, 0.0])
    morton_cells(0, 2, CORNERS, move, np.zeros(3), 1.0, codes)
    new_places(CORNERS, move, codes, sorted_rows(codes)[0])
    take_points(0, 2, CORNERS, move, sorted_rows(codes)[0], np.zeros((2, 3)))
    split_sorted_rows(codes)
    count_cells(codes)
    filled_cells(CORNERS, move, np.zeros(3), 1.0, 0)
    codes, counts, means, scatters = cells_of_points(CORNERS, move, np.zeros(3), 1.0)
    starts, blocks, table, weights, weighted = cell_blocks(codes, counts, scatters, 1.0)
    fits, rims, asked, edges = np.zeros((3, 7)), np.zeros(3, np.bool_), np.ones(3, np.bool_), (1.0,) * 5
    given = starts, blocks, table, means, weights, weighted
    cell_planes(0, len(starts) - 1, *given, *edges, asked, fits, rims)
    joined_cells(starts, counts, means, scatters, fits)
    hand_down(starts, fits[: len(starts) - 1], rims[: len(starts) - 1], fits, rims)
    normals, residuals, _, _, heights, usual, _ = plane_columns(fits)
    smoothed_means(means, normals, residuals, heights, usual)
    held_by_sure(normals, residuals, 1.0)
    share_of_lined(counts, scatters, 1.0, 1.0)
    scatter_of_most(CORNERS, 1.0)


def fit_neighbourhoods() -> None:
    """Planes and shapes of neighbourhoods, and which of them match."""
    corners, rows, none = CORNERS, np.zeros((0, 3), dtype=np.int64), np.zeros(1, dtype=np.bool_)
    quadric_residual_rows(0, 0, corners, rows, np.zeros((1, 3)), 0.5, np.zeros(1))
    majority_plane_rows(0, 0, corners, rows, corners, np.zeros((1, 3), dtype=np.int64), 1, 0.5, 0.5, np.zeros(1))
    edge_plane_rows(0, 0, corners, rows, 1, 0.5, 1.0, 1, 1, np.zeros((1, 3)), np.zeros(1), none)
    lined_runs(0, 0, corners, FIRST, FIRST, 1, 1, 0.5, none, np.zeros((1, 2, 3)), np.zeros((1, 2)))
    with_others_rows(0, 0, FIRST, corners, corners, 1.0, 0.5, 0.5, 1, none)
    near, far, motion = np.full(3, -1), np.zeros(3), np.eye(4)[:3].copy()
    close_points(0, 0, np.zeros((1, 6)), corners, LEAF_POINTS, FIRST, corners, corners, motion, 1.0, 1.0, near, far)
    plain, open_all = (corners, corners), np.zeros(3, dtype=np.bool_)
    facing_matches(*plain, motion, near, *plain, open_all, 1.0, 0.0, True, near.copy(), far, far.copy())


def look_along_rays() -> None:
    """Depth images."""
    image, counts = np.full((1, 1), np.inf), np.zeros(2, dtype=np.int64)
    directions_from(0, 0, CORNERS, FLAT, ONE, np.zeros((2, 3)), ONE)
    fill_nearest(np.zeros((2, 0)), np.zeros(0), ONE, 1.0, image, FIRST)
    count_behind(np.zeros(0), image, FIRST, 1.0)
    least_around(image, image.copy())
    count_before(CORNERS[:0], FLAT, ONE, ONE, 1.0, image, np.zeros((1, 1), dtype=np.bool_), 1.0, 1.0, counts)


def step_between_clouds() -> None:
    """Followed matches, and one pass over them."""
    rows, ones, nothing, numbers = CORNERS, np.ones(3), np.zeros(0), np.zeros(3, dtype=np.int64)
    tree, nearest, none = PointTree.of(rows), np.zeros((3, 2), dtype=np.int32), np.zeros(0, dtype=bool)
    held = tree.boxes, tree.places, tree.leaf, tree.rows, rows, rows, ones, numbers
    found = numbers.copy(), np.zeros(3), np.zeros(3), nearest.copy(), np.eye(3), np.eye(3), np.zeros(3), numbers.copy()
    follow_in_tree(0, 3, rows, rows, nearest, ones, 1.0, *held, *found)
    of_source, of_target = (rows, rows, rows, rows, ones, nothing, nothing), (rows, rows, ones, ones)
    limits, lowering = np.ones(5), Lowering(1.0, 1.0, 1.0, 1.0, 1.0)
    stepping = Stepping(1, 0.5, 0.1, 1.0, 1, 1.0, 1.0, 1.0, 1.0)
    how = none, nothing, limits, lowering, stepping, 3
    results = np.zeros(3), np.zeros(3), np.zeros((1, WEIGHED)), np.eye(4)
    given: Any = np.eye(4), *of_source, *of_target, *how, *results
    plane_pass(*given)
    lower_weights(rows, rows, rows, ones, none, ones, ones, lowering, np.ones(3))
    bend_of(1.0, 2.0, 0.5, 0.1, 1.0)


def measure_steps() -> None:
    """What a loop learns at each step."""
    rows, ones, none, lines = np.eye(3), np.ones(3), np.zeros(3, dtype=np.bool_), np.zeros(3, dtype=np.int64)
    fit_mixture(ones, 1.0, 0.5, 2.0, 1, 1.0, 1e-300, 1e-3, -1e300, 1e-8)
    spread_of(rows, mean := np.zeros(3), covariance := np.zeros((3, 3)))
    rms_motion(np.eye(4), np.eye(4), mean, covariance)
    move_rows(0, 3, rows, np.eye(4), rows.copy())
    normal_variances(ones, ones, 16.0, np.zeros(3))
    rough_rows(ones, ones, 0.5, lines)
    known_rims(lines, none, none, none.copy(), lines.copy())


def keep_maps() -> None:
    """The map of the odometry."""
    flat, one, first = np.eye(3), np.zeros(3), np.zeros(1, dtype=np.int64)
    first_of_voxels(flat, 1.0)
    one_of_voxels(flat, 1.0)
    VoxelSums.of(flat, None, 1.0, 1.0).means_at(flat)
    measured_rows(flat, 1.0, np.zeros(3), np.zeros(3))
    swept_rows(0, 0, flat, one, np.zeros(6), flat)
    many, table, cells = (
        np.zeros((3, 2), dtype=np.int64),
        np.zeros(8, dtype=np.int32),
        np.zeros((3, 64), dtype=np.int32),
    )
    keys, members = np.zeros((3, 3), dtype=np.int64), np.zeros((3, 1), dtype=np.int32)
    slots, sums = np.zeros((3, 1, 3), dtype=np.float32), np.zeros((3 * CELLS, SUMS), dtype=np.float32)
    put_blocks(keys, 0, table)
    held = flat.copy(), many, table, keys, cells, many.copy(), slots, members
    admit_points(flat, 1.0, 1.0, 1, *held, sums, first.repeat(3))
    distances_in_voxels(0, 0, flat, 1.0, 1.0, *held, one)
    kept, before = np.zeros((3 * CELLS, 9)), np.zeros((0, 3))
    found = first.repeat(3), one, one, flat, flat, one
    closest_in_voxels(0, 0, flat, 1.0, 1.0, 1.0, *held, sums, kept, 1, before, before[:, 0], 1.0, 1.0, *found)
    planes_in_cells(
        0, 0, flat, 1.0, 1.0, table, keys, cells, sums, kept, 1, 1.0, keys, first.repeat(3), one, flat, flat, one, one
    )
    leave_out_beams(flat, one, 1.0, flat, flat, one, one, True)
    grid, steps = np.zeros((1, 2), dtype=np.int32), np.zeros((0, 2), dtype=np.int64)
    runs_around(np.zeros((1, 1), dtype=np.bool_))
    count_on_runs(steps, keys, first, grid)
    count_at_shifts(0, 0, steps, steps, np.zeros((1, 1), dtype=np.bool_), grid[0])
    figures, planes = np.zeros(FIGURES), (flat, flat, one, one, one)
    weigh_by_roughness(one, one.copy(), 1.0)
    step_on_planes(flat, flat, *planes, np.ones(11), 0, np.eye(4), np.zeros(3), figures)
    step_on_planes_of_sweep(flat, one, *planes, np.ones(10), 0, np.eye(4), np.zeros(6), np.zeros(3), figures)


def search_poses() -> None:
    """What looks up pairs of points, and has many poses at once."""
    rotations, places = np.eye(3)[None], np.zeros((1, 3))
    drawn_rows(ONE + 1.0, NOTHING, FIRST.copy(), FIRST[:0])
    pair_keys(0, 0, FLAT, FLAT, FIRST[:0], FIRST[:0], 1.0, ONE, ONE, FIRST[:0])
    table, held = np.zeros((1, 1), dtype=np.int32), np.zeros(1, dtype=np.int32)
    all_pair_keys(0, 1, places, places, 1.0, ONE, ONE, table)
    key_starts(table, np.zeros(2, dtype=np.int64))
    order_of_keys(table, FIRST, held, held.copy())
    far, grid = np.ones(1, dtype=np.float32), (places, SHAPE)
    nearest_at_corners(*grid, held, far)
    nearest_at_nodes(0, 1, *grid, held, far)
    nearest_from_coarser(0, 1, *grid, SHAPE, held.copy(), held, far)
    planes_at_nodes(0, 1, held, places, places, np.zeros((1, 6), dtype=np.float32))
    poses_within(0, 1, rotations, places, places, SHAPE, far, 1.0, np.zeros(1, dtype=np.bool_))
    sides = 2 * (FLAT, FLAT, FIRST[:0], FIRST[:0])
    agree = np.zeros((2, 0), dtype=np.bool_)
    pair_poses(0, 0, *sides, 1.0, 1.0, np.zeros((2, 0, 3, 3)), np.zeros((2, 0, 3)), agree)
    mean_gains(0, 1, rotations, places, places, SHAPE, np.zeros(2, dtype=np.float32), np.zeros(1))
    grid_places(0, 0, FLAT, ONE, 1.0, SHAPE, np.zeros(1, dtype=np.int32), FLAT, FLAT, np.zeros(0))
    grid_planes(0, 0, FLAT, ONE, 1.0, SHAPE, np.zeros((1, 6), dtype=np.float32), FLAT, FLAT, np.zeros(0), FIRST[:0])
    poses, sums = (rotations.copy(), places, places), (np.zeros((1, 6, 6)), np.zeros((1, 6)))
    add_plane_steps(0, 0, *poses, *(FLAT,) * 4, NOTHING, *(1.0,) * 4, *sums)
    take_damped_steps(0, 0, *poses, *sums, *(1.0,) * 3, *poses[:2])
    distinct_rows(rotations, places, 1.0, 1.0, 1)
    log_likelihoods(0, 1, np.ones((1, 1)), 1.0, 0.5, 0.001, 1)
