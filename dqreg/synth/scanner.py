"""Virtual scanner: views of a mesh, with the noise, dropouts and outliers of a real one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.synth.cameras import Pattern, unit
from dqreg.synth.motion import Motion
from dqreg.synth.noise import Noise, PixelErrors
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import SweepHits, cast_sweep, centre_and_diagonal, check_mesh, joined
from dqreg.synth.scan import Scan


def scan_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    scanner: Pattern,
    noise: Noise | None = None,
    *,
    rng: np.random.Generator,
    motion: Motion | None = None,
    surroundings: Mesh | None = None,
) -> Scan:
    """Scan a mesh from all views of a scanner.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Mesh vertices; their bounding box gives the part's centre and diagonal.
    faces : array_like, (f, 3)
        Vertex indices, outward normals by the right-hand rule.
    scanner : Scanner, StructuredLight or Lidar
        Where it is seen from and how finely.
    noise : Noise, optional
        Error model; by default there are no errors, and every point lies on the mesh to 1e-12 of its size.
    rng : numpy.random.Generator
        Source of all randomness.
    motion : Motion, optional
        How part and surroundings move against the scanner during the sweep; at rest by default. The points are as
        the scanner reads them; `Scan.undone` puts them back.
    surroundings : (vertices (w, 3), faces (g, 3)), optional
        What else the rays can meet, in the part's frame.

    Returns
    -------
    Scan
        In the part's frame at the motion's reference time and in its unit, ordered by view and pixel.

    Raises
    ------
    InputError
        If the mesh is malformed, the noise does not fit the part's size, or no ray brings a point back.
    MissingDependencyError
        If Open3D cannot be loaded.

    Notes
    -----
    Same mesh, scanner, noise and generator state: same bytes on one kind of processor and library version, the
    same points to rounding elsewhere. All random numbers are drawn for every pixel, hit or not, so a ray that
    just misses an edge on another machine changes no other point. A ray that meets a face from behind first (a
    mesh with holes) brings nothing back.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> from dqreg.synth.cameras import Scanner
    >>> scan = scan_mesh(*box(), Scanner(views=((0, 0, 1),), pixels=8), rng=np.random.default_rng(0))
    >>> scan.points[:, 2].tolist() == [0.5] * len(scan.points)
    True
    """
    part, noise = check_mesh(vertices, faces), noise or Noise()
    if surroundings is not None:
        surroundings = check_mesh(*surroundings)
    swept = cast_sweep(part, scanner, noise.max_incidence_rad, motion=motion, surroundings=surroundings)
    noise.require_fit(swept.diagonal)
    errors = noise.draw(swept.ranges.reshape(swept.image), swept.cosines.reshape(swept.image), swept.diagonal, rng)
    beside = None
    if noise.lateral_sigma:  # the last of all draws: without it nothing more is taken from the generator
        beside = scanner.ray_directions(noise.lateral_sigma * rng.standard_normal((*swept.image, 2)))
    seen = joined(part, surroundings)[0]
    outliers = centre_and_diagonal(seen)[0] + errors.in_box * np.ptp(seen, axis=0)
    points, rays = _readings(swept, errors, outliers, beside)
    if noise.quantisation:
        points = quantised(points, swept.origins, noise.quantisation)
    kept = errors.is_kept & swept.is_lit
    if not kept.any():
        raise InputError("no ray brought a point back; check views, field_of_view_rad and max_incidence_rad")
    is_outlier = (errors.is_outlier | errors.is_mixed)[kept]
    on_part = ~is_outlier & (swept.face_index[kept] < len(part[1]))
    total = np.hypot(errors.sigma, _lateral_sigma(swept, scanner, noise.lateral_sigma))
    return Scan(
        points=points[kept],
        ray_directions=rays[kept],
        normals=np.where(is_outlier[:, None], np.nan, swept.normals[kept]),
        view_index=swept.view_index[kept],
        sensor_positions=swept.sensors,
        is_outlier=is_outlier,
        on_part=on_part,
        face_index=np.where(on_part, swept.face_index[kept], -1),
        range_sigma=np.where(is_outlier, np.nan, errors.sigma[kept]),
        total_sigma=np.where(is_outlier, np.nan, total[kept]),
        times=swept.times[kept],
    )


def quantised(points: FloatArray, origins: FloatArray, step: float) -> FloatArray:
    """Round the distances of points to multiples of a step."""
    ways = points - origins
    ranges = np.linalg.norm(ways, axis=1, keepdims=True)
    rounded: FloatArray = origins + np.round(ranges / step) * step * (ways / ranges)
    return rounded


def _readings(
    swept: SweepHits, errors: PixelErrors, outliers: FloatArray, beside: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Points as they are read and their rays; ``beside``: rays instead of the true ones."""
    points, rays = swept.points + errors.range_error[:, None] * swept.rays, swept.rays
    if beside is not None:
        rays = beside.reshape(-1, 3)
        points = swept.origins + (swept.ranges + errors.range_error)[:, None] * rays
    is_outlier = errors.is_outlier[:, None]
    points = np.where(is_outlier, outliers, points)
    return points, np.where(is_outlier, unit(points - swept.origins), rays)


def _lateral_sigma(swept: SweepHits, scanner: Pattern, lateral_sigma: float) -> FloatArray:
    """Range noise that would take each point as far off its face as lateral noise does, (n,)."""
    if not lateral_sigma:
        return np.zeros(len(swept.ranges))
    squares = np.zeros(len(swept.ranges))
    for axis in (0, 1):
        half = np.zeros((*swept.image, 2))
        half[..., axis] = 0.5
        pixel = (scanner.ray_directions(half) - scanner.ray_directions(-half)).reshape(-1, 3)
        squares += np.einsum("ni,ni->n", pixel, swept.normals) ** 2
    # NaN where a ray meets nothing, infinite where it runs along a face; neither brings a point back.
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma: FloatArray = lateral_sigma * swept.ranges * np.sqrt(squares) / np.abs(swept.cosines)
    return sigma
