"""What lies around a part: a table or a bin, and other things on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray, as_float
from dqreg._numbers import is_whole
from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth import parts
from dqreg.synth.cameras import is_within
from dqreg.synth.parts.kinds import of_box
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import centre_and_diagonal, joined

KINDS = ("none", "table", "bin")
# What clutter is made of, each at its default size before it is scaled; the rest of the part's shelf-mates.
_CLUTTER = ("angle", "block", "bracket", "cylinder", "flange", "prism")
# Thickness of table and walls in diagonals of the part.
_SHEET_THICKNESS_DIAGONALS = 0.03
# Positions tried for each object; the most objects.
_MAX_POSITIONS, _MAX_OBJECTS = 2_000, 200


@dataclass(frozen=True)
class Scene:
    """Surroundings of a part; lengths count in diagonals of the part.

    Attributes
    ----------
    kind : str
        "none", "table" (a flat plate below the part) or "bin" (with four walls).
    up : (float, float, float)
        Direction in the part's frame that points up; the part rests on what lies lowest.
    size : float
        Side of the table, or of the bin inside; the part is in the middle.
    wall_height : float
        Height of the bin's walls.
    clutter : int
        Number of other things around the part: parts of other kinds, of 0.3 to 0.7 diagonals, at random places
        where they touch neither the part nor each other.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> Scene(kind="table", clutter=6).size
    3.0
    """

    kind: str = "none"
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    size: float = 3.0
    wall_height: float = 0.4
    clutter: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError.of(f"must be one of {', '.join(KINDS)}", name="kind", given=self.kind)
        up = as_float(self.up, "up")
        if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
            raise InputError.of("must be three numbers that are not all zero", name="up", given=self.up)
        if not is_within(self.size, 1.0, 100.0):
            raise InputError.of("must lie between 1 and 100 diagonals of the part", name="size", given=self.size)
        if not is_within(self.wall_height, 0.0, 100.0):
            raise InputError.of("must lie between 0 and 100 diagonals", name="wall_height", given=self.wall_height)
        if not is_whole(self.clutter) or not 0 <= self.clutter <= _MAX_OBJECTS:
            raise InputError.of(f"must be a whole number from 0 to {_MAX_OBJECTS}", name="clutter", given=self.clutter)
        if self.clutter and self.kind == "none":
            raise InputError.of('needs something to lie on; give kind = "table" or "bin"', name="clutter")

    def surroundings(self, vertices: FloatArray, rng: np.random.Generator) -> Mesh | None:
        """Build all but the part.

        Parameters
        ----------
        vertices : ndarray, (v, 3)
            Vertices of the part.
        rng : numpy.random.Generator
            Draws the clutter.

        Returns
        -------
        (vertices (w, 3), faces (g, 3)), or None
            In the part's frame and unit; None if there is nothing.

        Raises
        ------
        InputError
            If the clutter does not fit.

        Examples
        --------
        >>> scene = Scene(kind="bin")
        >>> scene.surroundings(np.array([[0.0, 0, 0], [3, 0, 4]]), np.random.default_rng(0))[1].shape
        (60, 3)
        """
        if self.kind == "none":
            return None
        R = _upright(as_float(self.up, "up"))
        upright = vertices @ R.T
        centre, diagonal = centre_and_diagonal(upright)
        floor = np.array([centre[0], centre[1], upright[:, 2].min()])
        mesh = _table(self.size * diagonal, _SHEET_THICKNESS_DIAGONALS * diagonal)
        if self.kind == "bin":
            mesh = joined(
                mesh, _walls(self.size * diagonal, self.wall_height * diagonal, _SHEET_THICKNESS_DIAGONALS * diagonal)
            )
        footprint = float(np.linalg.norm(upright[:, :2] - centre[:2], axis=1).max())
        for thing in _scatter(self.clutter, 0.5 * self.size * diagonal, footprint, diagonal, rng):
            mesh = joined(mesh, thing)
        return (mesh[0] + floor) @ R, mesh[1]


def _upright(up: FloatArray) -> FloatArray:
    """Rotation that brings a direction to z: its rows are an orthonormal frame with ``up`` last."""
    z = up / np.linalg.norm(up)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _slab(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    vertices, faces = parts.box(size=np.subtract(high, low).tolist())
    return vertices + 0.5 * np.add(low, high), faces


def _table(side: float, sheet: float) -> Mesh:
    half = 0.5 * side + sheet
    return _slab((-half, -half, -sheet), (half, half, 0.0))


def _walls(side: float, height: float, sheet: float) -> Mesh:
    h, out = 0.5 * side, 0.5 * side + sheet
    walls = [
        _slab((-out, -out, 0.0), (out, -h, height)),
        _slab((-out, h, 0.0), (out, out, height)),
        _slab((-out, -h, 0.0), (-h, h, height)),
        _slab((h, -h, 0.0), (out, h, height)),
    ]
    return joined(joined(walls[0], walls[1]), joined(walls[2], walls[3]))


def _scatter(count: int, half: float, footprint: float, diagonal: float, rng: np.random.Generator) -> list[Mesh]:
    """Draw things that rest on z = 0 beside a round footprint in the middle and beside each other."""
    middles, radii, things = np.zeros((1, 2)), np.array([footprint]), []
    for number in range(count):
        vertices, faces = _thing(diagonal, rng)
        radius = float(np.linalg.norm(vertices[:, :2], axis=1).max())
        tries = rng.uniform(-1.0, 1.0, (_MAX_POSITIONS, 2)) * max(half - radius, 0.0)
        gaps = np.linalg.norm(tries[:, None] - middles, axis=2) - radii - radius
        free = np.flatnonzero(gaps.min(axis=1) > 0.0)
        if not len(free) or radius > half:
            raise InputError.of(
                f"is too large: found room for {number} of {count} things; give a smaller number or more size",
                name="clutter",
            )
        middle = tries[free[0]]
        middles, radii = np.vstack([middles, middle]), np.append(radii, radius)
        things.append((vertices + np.append(middle, 0.0), faces))
    return things


def _thing(diagonal: float, rng: np.random.Generator) -> Mesh:
    """Draw a part of any kind on any of its six sides, its middle over the origin, resting on z = 0."""
    kind = _CLUTTER[rng.integers(len(_CLUTTER))]
    vertices, faces = parts.KINDS[kind].build()
    sides = of_box((1.0, 1.0, 1.0))
    turn = pose.exp([0.0, 0.0, rng.uniform(0.0, 2.0 * np.pi), 0.0, 0.0, 0.0]) @ sides[rng.integers(len(sides))]
    vertices = pose.rotate(turn, vertices)
    centre, own = centre_and_diagonal(vertices)
    scaled = (vertices - centre) * (rng.uniform(0.3, 0.7) * diagonal / own)
    return scaled - [0.0, 0.0, scaled[:, 2].min()], faces
