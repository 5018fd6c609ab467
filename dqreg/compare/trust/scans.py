"""Scans of the random parts: views, samples, noise and outliers, a few hundred to a few thousand points."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, sample_mesh
from dqreg.synth import Lidar, Noise, Scanner, StructuredLight, scan_mesh
from dqreg.synth.parts import box

# Range noise of a usual scanner, in diagonals of the part.
NOISE_DIAGONALS = 3e-4
VIEW_PIXELS = 120
# Neighbours that share noise; bells about the points in reach of each other, that make it.
SHARING_NEIGHBOURS, BELLS_PER_REACH = (100, 500), 8


def directions(count: int, rng: np.random.Generator) -> FloatArray:
    """Unit vectors, drawn evenly over the sphere."""
    vectors = rng.normal(size=(count, 3))
    found: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return found


def rows_of(*towards: FloatArray) -> tuple[tuple[float, float, float], ...]:
    """Directions as scanners take them."""
    return tuple((float(x), float(y), float(z)) for rows in towards for x, y, z in np.atleast_2d(rows))


def oblique(rng: np.random.Generator) -> FloatArray:
    """A direction from which three sides of a box are seen."""
    return rng.choice([-1.0, 1.0], 3) * rng.uniform(0.45, 1.0, 3)


def thinned(points: FloatArray, rng: np.random.Generator, low: int = 500, high: int = 3000) -> FloatArray:
    """Some of the points, in their order."""
    count = min(len(points), int(rng.integers(low, high)))
    return points[np.sort(rng.choice(len(points), count, replace=False))]


def views(mesh: Mesh, rng: np.random.Generator, towards: FloatArray, noise: float = NOISE_DIAGONALS) -> FloatArray:
    """Camera views from given directions."""
    scanner = Scanner(rows_of(towards), pixels=VIEW_PIXELS)
    error = Noise(range_sigma=noise * mesh.diagonal)
    return thinned(scan_mesh(mesh.vertices, mesh.faces, scanner, error, rng=rng).points, rng)


def two_views(mesh: Mesh, rng: np.random.Generator, noise: float = NOISE_DIAGONALS) -> FloatArray:
    """Views from two opposite corners, roughly."""
    towards = oblique(rng)
    return views(mesh, rng, np.stack([towards, -towards * rng.uniform(0.5, 1.5, 3)]), noise)


def one_view(mesh: Mesh, rng: np.random.Generator) -> FloatArray:
    """A view from one corner."""
    return views(mesh, rng, oblique(rng)[None], NOISE_DIAGONALS)


def depth_camera(mesh: Mesh, rng: np.random.Generator) -> FloatArray:
    """Views of a coarse camera: depth steps, flying pixels, lost grazing returns."""
    scale = mesh.diagonal
    error = Noise(
        range_sigma=1e-3 * scale,
        grazing_growth=0.5,
        dropout=0.3,
        mixed_share=0.2,
        lateral_sigma=0.3,
        quantisation=1e-3 * scale,
    )
    towards = oblique(rng)
    scanner = Scanner(rows_of(towards, -towards), pixels=VIEW_PIXELS)
    return thinned(scan_mesh(mesh.vertices, mesh.faces, scanner, error, rng=rng).points, rng)


def light_stripes(mesh: Mesh, rng: np.random.Generator) -> FloatArray:
    """Views of a structured-light scanner, which shadows itself."""
    towards = oblique(rng)
    scanner = StructuredLight(rows_of(towards, -towards), pixels=VIEW_PIXELS, baseline=0.3)
    error = Noise(range_sigma=NOISE_DIAGONALS * mesh.diagonal)
    return thinned(scan_mesh(mesh.vertices, mesh.faces, scanner, error, rng=rng).points, rng)


def rings(mesh: Mesh, rng: np.random.Generator) -> FloatArray:
    """Two stands of a spinning LiDAR: dense along a ring, sparse across."""
    towards = oblique(rng)
    scanner = Lidar(rows_of(towards, -towards), rings=24, azimuths=200)
    error = Noise(range_sigma=1e-3 * mesh.diagonal)
    return thinned(scan_mesh(mesh.vertices, mesh.faces, scanner, error, rng=rng).points, rng)


def shared_noise(points: FloatArray, along: FloatArray, sigma: float, rng: np.random.Generator) -> FloatArray:
    """The points moved along a direction by noise with a standard deviation that 100 to 500 neighbours share.

    Lenses, the flatness of a mirror, warmth and surfaces that shine err by as much for neighbours. The noise is that of
    a random field: a sum of bells with random heights about random points.
    """
    count = min(int(rng.integers(*SHARING_NEIGHBOURS)), len(points) // 2)
    tops = points[rng.choice(len(points), min(BELLS_PER_REACH * len(points) // count, len(points)), replace=False)]
    apart = np.linalg.norm(points[:, None] - tops, axis=2)
    width = 0.5 * float(np.median(np.partition(apart, count, axis=0)[count]))
    bells = np.exp(-0.5 * (apart / width) ** 2)
    field = bells @ rng.normal(size=len(tops)) / np.linalg.norm(bells, axis=1)
    moved: FloatArray = points + sigma * field[:, None] * along / np.linalg.norm(along)
    return moved


def sampled(mesh: Mesh, count: int, rng: np.random.Generator, noise: float = NOISE_DIAGONALS) -> FloatArray:
    """Points all over the surface."""
    points = sample_mesh(mesh, count, rng).points
    return points + noise * mesh.diagonal * rng.normal(size=points.shape)


def with_strays(points: FloatArray, share: float, rng: np.random.Generator) -> FloatArray:
    """The scan and points drawn evenly in a box 1.5 times as large: so large a share of all."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.75 * (high - low).max()
    count = round(len(points) * share / (1.0 - share))
    return np.concatenate([points, rng.uniform(middle - half, middle + half, (count, 3))])


def in_scene(
    mesh: Mesh, around: tuple[FloatArray, IntArray] | None, towards: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Camera views of a part and what stands around it."""
    scanner = Scanner(rows_of(towards), pixels=VIEW_PIXELS)
    error = Noise(range_sigma=NOISE_DIAGONALS * mesh.diagonal)
    points = scan_mesh(mesh.vertices, mesh.faces, scanner, error, rng=rng, surroundings=around).points
    return thinned(points, rng, 1500, 4000)


def block_at(middle: FloatArray, edge: float) -> Mesh:
    """A cube of an edge about a point."""
    vertices, faces = box((edge, edge, edge))
    return Mesh(vertices + middle, faces)


def dense_view(mesh: Mesh, rng: np.random.Generator, towards: FloatArray) -> FloatArray:
    """A camera view of 1,500 to 4,000 points."""
    scanner = Scanner(rows_of(towards), pixels=VIEW_PIXELS)
    error = Noise(range_sigma=NOISE_DIAGONALS * mesh.diagonal)
    return thinned(scan_mesh(mesh.vertices, mesh.faces, scanner, error, rng=rng).points, rng, 1500, 4000)
