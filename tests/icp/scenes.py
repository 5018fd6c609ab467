"""Small scenes for the tests of the loop: a rough cloud, a bracket, and pairs made by hand."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Closest, Mesh, PointCloud, Scan, prepare_scan
from dqreg.icp import Correspondences
from dqreg.rigid import twist
from dqreg.synth import Noise, Scanner, scan_mesh
from dqreg.synth.parts import bracket


def motion(angle_rad: float, offset: float, seed: int = 0) -> FloatArray:
    """A turn about the origin and a shift, both in random directions."""
    rng = np.random.default_rng(seed)
    axis, direction = rng.standard_normal((2, 3))
    return twist.exp(np.r_[angle_rad * axis / np.linalg.norm(axis), offset * direction / np.linalg.norm(direction)])


def bumpy_cloud(count: int = 3_000, seed: int = 0) -> FloatArray:
    """Points drawn on a wavy sheet about one unit across: no symmetry, and no lattice to lock into one cell off."""
    x, y = np.random.default_rng(seed).uniform(-0.5, 0.5, (2, count))
    return np.column_stack([x, y, 0.2 * np.sin(5.0 * x) * np.cos(4.0 * y + 1.0) + 0.1 * x * x])


def bracket_mesh() -> Mesh:
    """The part, moved to its middle as the front door does it."""
    vertices, faces = bracket()
    part = Mesh(vertices, faces)
    return Mesh(part.vertices - part.centre, part.faces)


def bracket_points(pixels: int, seed: int, sigma: float = 3e-4, outliers: float = 0.0) -> FloatArray:
    """Two views of `bracket_mesh`, noise along the rays in sizes of the part."""
    part = bracket_mesh()
    scanner = Scanner(views=((1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)), pixels=pixels)
    noise = Noise(range_sigma=sigma * part.diagonal, outlier_share=outliers)
    return scan_mesh(part.vertices, part.faces, scanner, noise, rng=np.random.default_rng(seed)).points


def made_pairs(count: int = 40, seed: int = 0, same_sign: bool = False) -> Correspondences:
    """Pairs at a known pose: points on a sheet, their true places with some noise, normals with random signs."""
    scan = prepare_scan(PointCloud(bumpy_cloud(count, seed)))
    rng = np.random.default_rng(seed + 1)
    T = motion(0.3, 0.2, seed)
    moved = scan.points @ T[:3, :3].T + T[:3, 3]
    targets = moved + rng.normal(0.0, 0.01, moved.shape)
    normals = scan.normals @ T[:3, :3].T + rng.normal(0.0, 0.1, moved.shape)
    normals *= rng.choice([-1.0, 1.0], (len(scan), 1)) / np.linalg.norm(normals, axis=1, keepdims=True)
    distances = np.linalg.norm(moved - targets, axis=1)
    return Correspondences(scan, T, Closest(targets, normals, distances, np.arange(len(scan))), same_sign)


def pairs_at(distances: FloatArray) -> Correspondences:
    """Pairs at given distances, without normals; all at the identity."""
    n = len(distances)
    points = np.column_stack([np.arange(n, dtype=float), np.zeros(n), np.zeros(n)])
    nothing = np.zeros((n, 3))
    scan = Scan(points, nothing, np.zeros(n), np.full(n, np.nan), oriented=False, spacing=1.0, noise=0.0, total=n)
    closest = Closest(points + distances[:, None] * [0.0, 0.0, 1.0], nothing, distances, np.arange(n))
    return Correspondences(scan, np.eye(4), closest, same_sign=False)
