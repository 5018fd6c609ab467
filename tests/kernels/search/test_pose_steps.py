from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dqreg.geometry import Mesh, MeshSurface
from dqreg.kernels import threads
from dqreg.kernels.search.pose_steps import add_plane_steps, take_damped_steps
from dqreg.kernels.threads import over_chunks
from dqreg.rigid import quaternion
from dqreg.search.features import even_points
from dqreg.search.grids import PlaneGrid
from dqreg.synth.parts import bracket

PART = Mesh(*bracket(segments=8))
LEAST, LEVER, SHARE, WIDTH = 0.5, 2.0, 0.01, 0.8


def case(poses: int, count: int, seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(poses, 4))
    R = quaternion.to_matrix(q / np.linalg.norm(q, axis=1, keepdims=True))
    directions, normals = rng.normal(size=(count, 3)), rng.normal(size=(poses * count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[::7] = 0.0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    distances = rng.uniform(0.0, 3.0, size=poses * count)
    distances[::5] = np.inf
    t, centres, places = rng.normal(size=(poses, 3)), rng.normal(size=(poses, 3)), rng.normal(size=(poses * count, 3))
    places[::5] = np.nan
    return R, t, centres, rng.normal(size=(count, 3)), directions, places, normals, distances


def plain(R, t, centres, points, directions, places, normals, distances) -> tuple[np.ndarray, np.ndarray]:
    """The same sums by NumPy, on the rows that are near."""
    count = len(points)
    moved, turned = points @ R.transpose(0, 2, 1) + t[:, None], directions @ R.transpose(0, 2, 1)
    weights = SHARE * np.exp(-0.5 * (distances.reshape(-1, count) / WIDTH) ** 2)
    if len(normals):
        normals = normals.reshape(moved.shape)
        cosines = np.abs(np.einsum("nmi,nmi->nm", turned, normals))
        weights *= (cosines > LEAST) | ~directions.any(axis=1)
    else:
        normals = turned
    gap = np.nan_to_num(moved - places.reshape(moved.shape))
    J = np.concatenate([np.cross((moved - centres[:, None]) / LEVER, normals), normals], axis=2)
    residuals = np.einsum("nmi,nmi->nm", gap, normals) / LEVER
    return np.einsum("nm,nmi,nmj->nij", weights, J, J), np.einsum("nm,nmi,nm->ni", weights, J, residuals)


def summed(arguments: tuple[np.ndarray, ...], chunk: int = 3) -> tuple[np.ndarray, np.ndarray]:
    poses = len(arguments[0])
    sums = np.zeros((poses, 6, 6)), np.zeros((poses, 6))
    over_chunks(add_plane_steps, poses, *arguments, WIDTH, LEAST, LEVER, SHARE, *sums, chunk=chunk)
    return sums


@pytest.mark.parametrize("faces", [True, False])
def test_the_sums_are_those_of_numpy(faces: bool) -> None:
    *rest, normals, distances = case(7, 40, 0)
    arguments = (*rest, normals if faces else np.zeros((0, 3)), distances)
    for found, expected in zip(summed(arguments), plain(*arguments), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13)


def test_any_number_of_threads_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, found = case(11, 30, 1), []
    for count in (1, 4):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        found.append(b"".join(part.tobytes() for part in summed(arguments)))
    assert len(set(found)) == 1


def test_damped_steps_solve_their_equations_and_move_about_their_centres() -> None:
    R, t, centres, *_ = case(7, 40, 2)
    H, g = summed(case(7, 40, 2))
    H[3] = 0.0
    g[3] = 0.0
    turned, shifted = np.full(R.shape, np.nan), np.full(t.shape, np.nan)
    take_damped_steps(0, 7, R, t, centres, H, g, LEVER, 1e-4, 1e-12, turned, shifted)
    for k in range(7):
        damped = H[k] + max(1e-4 * np.trace(H[k]) / 6.0, 1e-12) * np.eye(6)
        step = np.linalg.solve(damped, -g[k])
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        np.testing.assert_allclose(turned[k], turn @ R[k], atol=1e-9)
        np.testing.assert_allclose(shifted[k], turn @ (t[k] - centres[k]) + centres[k] + LEVER * step[3:], atol=1e-9)


def test_planes_of_a_grid_are_those_of_the_nearest_node() -> None:
    surface = MeshSurface(PART)
    low, high = PART.vertices.min(axis=0), PART.vertices.max(axis=0)
    grid = PlaneGrid(surface, even_points(PART, surface, 2_000), low, high)
    rng = np.random.default_rng(2)
    points = rng.uniform(low - 0.1 * PART.diagonal, high + 0.1 * PART.diagonal, size=(3_000, 3))
    found, nodes = grid.closest(points), grid.nodes(points)
    np.testing.assert_array_equal(found.elements, nodes)
    np.testing.assert_array_equal(np.isinf(found.distances), nodes == grid.count)
    planes = grid._planes[nodes].astype(np.float64)
    heights = np.einsum("ij,ij->i", points - planes[:, :3], planes[:, 3:])
    feet = points - heights[:, None] * planes[:, 3:]
    np.testing.assert_allclose(found.points, feet, atol=1e-12 * PART.diagonal)
    # As far aside as the node, but for the node's own cell.
    aside = np.maximum(np.linalg.norm(feet - planes[:, :3], axis=1) - grid.cell, 0.0)
    inside = nodes < grid.count
    np.testing.assert_allclose(found.distances[inside], np.hypot(heights, aside)[inside], atol=1e-7 * PART.diagonal)
