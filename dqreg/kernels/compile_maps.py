"""Kernels of the odometry: what `compile_all` compiles of them."""

from __future__ import annotations

import numpy as np

from dqreg.kernels.cell_matches import planes_in_cells
from dqreg.kernels.plane_steps import FIGURES, step_on_planes
from dqreg.kernels.sweep_steps import step_on_planes_of_sweep
from dqreg.kernels.swept_rows import swept_rows
from dqreg.kernels.voxel_blocks import put_blocks
from dqreg.kernels.voxel_nearest import distances_in_voxels
from dqreg.kernels.voxel_planes import closest_in_voxels
from dqreg.kernels.voxel_points import CELLS, SUMS, admit_points
from dqreg.kernels.voxel_rows import first_of_voxels, means_of_voxels


def compile_maps() -> None:
    """Call each once."""
    flat, one, first = np.eye(3), np.zeros(3), np.zeros(1, dtype=np.int64)
    first_of_voxels(flat, 1.0)
    means_of_voxels(flat, None, 1.0, 1.0)
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
    kept, before = np.zeros((3 * CELLS, 8)), np.zeros((0, 3))
    found = first.repeat(3), one, one, flat, flat, one
    closest_in_voxels(0, 0, flat, 1.0, 1.0, *held, sums, kept, 1, before, before[:, 0], 1.0, 1.0, *found)
    planes_in_cells(
        0, 0, flat, 1.0, table, keys, cells, sums, kept, 1, 1.0, keys, first.repeat(3), one, flat, flat, one
    )
    figures = np.zeros(FIGURES)
    step_on_planes(flat, flat, flat, flat, one, np.ones(9), 0, np.eye(4), np.zeros(3), figures)
    step_on_planes_of_sweep(flat, one, flat, flat, one, np.ones(8), 0, np.eye(4), np.zeros(6), np.zeros(3), figures)
