"""Tactile probe: a few dozen single points with exact normals, as a coordinate measuring machine takes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, as_vectors
from dqreg._numbers import is_whole
from dqreg.errors import InputError
from dqreg.geometry.mesh import Mesh as Surface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.synth.cameras import is_within, unit
from dqreg.synth.coverage import sample_surface
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import centre_and_diagonal, check_mesh, first_hits
from dqreg.synth.scan import Scan

_ALL_SIDES = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
# Positions tried for each point, and the most points of a scan.
_TRIES_PER_POINT, _MAX_POINTS = 50, 10_000
# Length of the last, straight part of the way to the surface, in diagonals of the part.
_STROKE_DIAGONALS = 1.0 / 32.0
# How much nearer than its radius the ball's centre may seem to be to the part: rounding of a closest point.
_TOUCH_ROUNDING = 1e-9


@dataclass(frozen=True)
class TactileProbe:
    """A ball on a stylus that touches the part along its normals.

    Attributes
    ----------
    points : int
        Number of points.
    probe_radius : float
        Radius of the ball, a length in the unit of the part (not in diagonals). The ball must fit: no place is
        touched where it would meet another face first.
    compensated : bool
        True: the points are those of contact, on the surface. False: they are the centres of the ball, off the
        surface by ``probe_radius`` along the normal, as a machine gives them that does not know the normals.
    views : sequence of (float, float, float)
        Directions from the part from which the stylus may come; all six sides by default.
    max_tilt_rad : float
        Greatest angle between the normal and the nearest of these directions.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> TactileProbe(points=25, probe_radius=1.0).compensated
    True
    """

    points: int = 40
    probe_radius: float = 0.0
    compensated: bool = True
    views: tuple[tuple[float, float, float], ...] = _ALL_SIDES
    max_tilt_rad: float = float(np.deg2rad(75.0))

    def __post_init__(self) -> None:
        if not is_whole(self.points) or not 1 <= self.points <= _MAX_POINTS:
            raise InputError.of(f"must be a whole number from 1 to {_MAX_POINTS}", name="points", given=self.points)
        if not (self.probe_radius == 0.0 or is_within(self.probe_radius, 0.0, np.inf)):
            raise InputError.of("must be a length that is not negative", name="probe_radius", given=self.probe_radius)
        if not isinstance(self.compensated, bool):
            raise InputError.of("must be true or false", name="compensated", given=self.compensated)
        views = as_vectors(self.views, "views")
        if not len(views) or not np.linalg.norm(views, axis=1).all():
            raise InputError.of("must be one or more directions that are not zero", name="views", given=self.views)
        if not is_within(self.max_tilt_rad, 0.0, 0.5 * np.pi):
            raise InputError.of(
                "must lie between 0 and a right angle", name="max_tilt_rad", given=self.max_tilt_rad, unit="rad"
            )


def touch_mesh(
    vertices: ArrayLike, faces: ArrayLike, probe: TactileProbe, sigma: float = 0.0, *, rng: np.random.Generator
) -> Scan:
    """Touch a mesh at random points, uniform over the surface that the probe can reach.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Mesh vertices.
    faces : array_like, (f, 3)
        Vertex indices, outward normals by the right-hand rule.
    probe : TactileProbe
        The probe and how many points it takes.
    sigma : float
        Standard deviation of the contact along the normal, a length in the unit of the part.
    rng : numpy.random.Generator
        Source of all randomness.

    Returns
    -------
    Scan
        Points in the order in which they are taken; the normals are exact, the rays lead against them, and
        ``sensor_positions`` holds where each stroke began: 1/32 of the diagonal off the surface.

    Raises
    ------
    InputError
        If the mesh is malformed, or the probe reaches less of it than it takes for so many points.

    Notes
    -----
    A position counts as reached if its normal is within ``max_tilt_rad`` of a direction of approach, nothing lies on
    the normal within the stroke, and the ball that touches there meets no other face. So bores are touched too;
    whether a stylus of some length gets there is not asked.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> scan = touch_mesh(*box(), TactileProbe(points=5, views=((0, 0, 1),)), rng=np.random.default_rng(0))
    >>> scan.points[:, 2].tolist(), scan.normals[0].tolist()
    ([0.5, 0.5, 0.5, 0.5, 0.5], [0.0, 0.0, 1.0])
    """
    part = check_mesh(vertices, faces)
    _, diagonal = centre_and_diagonal(part[0])
    if not 0.0 <= sigma <= 0.1 * diagonal:
        raise InputError.of(
            f"must lie between 0 and a tenth of the part's diagonal {diagonal:.4g}", name="sigma", given=sigma
        )
    if probe.probe_radius > 0.1 * diagonal:
        raise InputError.of(
            f"must be at most a tenth of the part's diagonal {diagonal:.4g}; got {probe.probe_radius:g}. "
            "Is it in the unit of the part?",
            name="probe_radius",
        )
    contacts, normals, face_index = sample_surface(*part, _TRIES_PER_POINT * probe.points, rng)
    stroke = _STROKE_DIAGONALS * diagonal
    reached = np.flatnonzero(_is_reached(part, probe, contacts, normals, stroke))[: probe.points]
    if len(reached) < probe.points:
        raise InputError.of(
            f"is too large: the probe reaches only {len(reached)} of {len(contacts)} positions tried, "
            f"{probe.points} are asked for; add views, or give a smaller probe_radius",
            name="points",
        )
    contacts, normals = contacts[reached], normals[reached]
    noise = sigma * rng.standard_normal((probe.points, 1))
    offset = 0.0 if probe.compensated else probe.probe_radius
    return Scan(
        points=contacts + (noise + offset) * normals,
        ray_directions=-normals,
        normals=normals,
        view_index=np.arange(probe.points),
        sensor_positions=contacts + stroke * normals,
        is_outlier=np.zeros(probe.points, dtype=bool),
        on_part=np.ones(probe.points, dtype=bool),
        face_index=face_index[reached],
        range_sigma=np.full(probe.points, float(sigma)),
        total_sigma=np.full(probe.points, float(sigma)),
        times=(np.arange(probe.points) + 0.5) / probe.points,
    )


def _is_reached(part: Mesh, probe: TactileProbe, contacts: FloatArray, normals: FloatArray, stroke: float) -> BoolArray:
    towards = (normals @ unit(as_vectors(probe.views, "views")).T).max(axis=1)
    reached: BoolArray = towards >= np.cos(probe.max_tilt_rad)
    # The way out starts a little off the face, or the ray would meet the face itself.
    _, blocks = first_hits(*part, contacts + 1e-5 * stroke * normals, normals)
    reached &= ~(np.linalg.norm(blocks - contacts, axis=1) < stroke)  # NaN where nothing is in the way
    if probe.probe_radius:
        centres = contacts + probe.probe_radius * normals
        gaps = MeshSurface(Surface(*part)).closest(centres).distances
        reached &= gaps >= (1.0 - _TOUCH_ROUNDING) * probe.probe_radius
    return reached
