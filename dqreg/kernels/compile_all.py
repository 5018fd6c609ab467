"""All kernels at once, on next to no data: what `dqreg doctor --compile` does when an image is built."""

from __future__ import annotations

import numpy as np

from dqreg.kernels.cache import keep_beside_package
from dqreg.kernels.close_points import close_points, facing_matches
from dqreg.kernels.components import components
from dqreg.kernels.disc_pairs import SUMS, disc_pair_sums
from dqreg.kernels.largest_eigenvectors import largest_eigenvectors
from dqreg.kernels.many_poses import distinct_rows, log_likelihoods, mean_gains
from dqreg.kernels.morton import morton_cells, new_places, sorted_rows
from dqreg.kernels.newton_steps import newton_steps
from dqreg.kernels.plane_fits import fit_plane_rows
from dqreg.kernels.point_tree import LEAF, PointTree
from dqreg.kernels.points_on_faces import points_on_faces
from dqreg.kernels.pose_steps import add_plane_steps, grid_planes
from dqreg.kernels.pseudo_normals import add_scaled_rows, corner_angles, pseudo_normals_at
from dqreg.kernels.rims import line_rows, one_sided_rows
from dqreg.kernels.triangle_tree import TriangleTree
from dqreg.kernels.weighing import SUMS as WEIGHED
from dqreg.kernels.weighing import weigh_rows
from dqreg.kernels.weighted_planes import COLUMNS, NUMBERS, mean_sums, orientation_precisions, plane_sums


def compile_all() -> None:
    """Compile every kernel for the arrays that it is called with, and keep the code for every user of the package."""
    keep_beside_package()
    corners = np.eye(3)[None] + np.arange(2.0)[:, None, None]
    codes = np.zeros(2, dtype=np.uint64)
    morton_cells(0, 2, corners[0], np.zeros(3), 1.0, codes)
    new_places(corners[0], codes, sorted_rows(codes))
    faces = TriangleTree.of(corners, np.ones((2, 3)))
    faces.closest(np.zeros((1, 3)))
    faces.cells.learn(np.zeros(2, dtype=np.int64))
    largest_eigenvectors(0, 1, np.eye(3)[:, :, None].copy(), np.zeros((3, 1)), np.zeros((4, 1)))
    tree = PointTree.of(corners[0])
    rows, _ = tree.nearest(corners[0], 3)
    near, far, motion = np.full(3, -1), np.zeros(3), np.eye(4)[:3].copy()
    place = tree.boxes, tree.places, LEAF, tree.rows, corners[0]
    close_points(0, 3, *place, corners[0], motion, 1.0, 1.0, near, far)
    plain, open_all = (corners[0], corners[0]), np.zeros(3, dtype=np.bool_)
    facing_matches(*plain, motion, near, *plain, open_all, 1.0, 0.0, True, near.copy(), far, far.copy())
    fit_plane_rows(0, 0, corners[0], rows, np.zeros((1, 3)), np.zeros(1), np.zeros(1))
    few, none = np.zeros((0, 2), dtype=np.int32), np.zeros(0, dtype=np.bool_)
    one_sided_rows(0, 0, corners[0], np.zeros(0, dtype=np.int64), few, np.zeros(0), corners[0], 0.25, 0.15, none)
    line_rows(0, 0, corners[0], few, 0.15, none)
    flat, one = corners[0], np.zeros(3)
    disc_pair_sums(0, 0, flat, flat, flat, flat, one, one, one, np.zeros((2, 3)), 1, np.zeros((1, SUMS)))
    newton_steps(np.eye(13), np.r_[np.eye(3).ravel(), np.zeros(3), 1.0], 1.0, 1, 1.0, 1.0, 1.0, 1.0)
    none_joined = np.zeros(0, dtype=np.int64)
    components(1, none_joined, none_joined)
    rows3, ones, none_at_all = np.eye(3), np.ones(3), np.zeros(0)
    limits, weighed = np.ones(5), np.zeros((1, WEIGHED))
    weigh_rows(0, 3, ones, *(rows3,) * 3, *(none_at_all,) * 3, limits, 3, np.zeros(3), weighed)
    mean_sums(0, 3, rows3, rows3, rows3, ones, 3, np.zeros((1, COLUMNS)))
    plane_sums(0, 3, rows3, rows3, rows3, ones, np.zeros((2, 3)), 3, np.zeros((1, NUMBERS, NUMBERS)))
    orientation_precisions(rows3, ones, ones, 1, 1.0, 1.0, np.zeros((2, 8)), np.zeros(3))
    first, on = np.zeros(1, dtype=np.int64), np.zeros((1, 3), dtype=bool)
    points_on_faces(0, 1, rows3, 3, corners, first, rows3, np.eye(4), 1.0, 1.0, 1.0, on, np.zeros((1, 3)), np.zeros(1))
    gains, shape = np.zeros(2, dtype=np.float32), np.ones(3, dtype=np.int64)
    mean_gains(0, 1, np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)), shape, gains, np.zeros(1))
    nothing, planes = np.zeros(0), np.zeros((1, 6), dtype=np.float32)
    grid_planes(0, 0, flat, one, 1.0, shape, planes, flat, flat, nothing, np.zeros(0, dtype=np.int64))
    poses = np.eye(3)[None].copy(), np.zeros((1, 3)), np.zeros((1, 3))
    add_plane_steps(0, 0, *poses, *(flat,) * 4, nothing, *(1.0,) * 4, np.zeros((1, 6, 6)), np.zeros((1, 6)))
    corner_angles(0, 0, corners, flat)
    add_scaled_rows(flat, 1, nothing, np.zeros(0, dtype=np.int64), flat)
    pseudo_normals_at(0, 0, flat, flat, first, corners, corners, first[None], flat, 1e-6, flat)
    distinct_rows(np.eye(3)[None], np.zeros((1, 3)), 1.0, 1.0, 1)
    log_likelihoods(0, 1, np.ones((1, 1)), 1.0, 0.5, 0.001, 1)
