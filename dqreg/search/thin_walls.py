"""Thin walls of a part: which directions its plane faces look to that have another face close behind them."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Surface
from dqreg.geometry.sampling import places_on
from dqreg.geometry.vector_rows import row_dots

# Places of a part that are asked; thickest wall that is thin, in sizes of the part.
ASKED_PLACES, MAX_THICKNESS_DIAGONALS = 400, 0.03
# Rounds of a ball that shrinks: between two planes two are enough. It touches what is no nearer than so much of it.
BALL_ROUNDS, CONTACT_TOLERANCE = 6, 1e-3
# The far side of a wall looks the other way within this; places of one direction differ by no more.
OPPOSITE_RAD, SAME_DIRECTION_RAD = np.deg2rad(20.0), np.deg2rad(10.0)
# Walls of one direction are as thick within this share; so large a share of all places makes one.
THICKNESS_TOLERANCE, MIN_WALL_SHARE = 0.2, 0.03


@dataclasses.dataclass(frozen=True, eq=False)
class ThinWalls:
    """Thin walls by the directions of their faces: both sides of a wall are two of them."""

    normals: FloatArray  # (k, 3): Out of the material
    thickness: FloatArray  # (k,)

    @staticmethod
    def none() -> ThinWalls:
        """No walls."""
        return ThinWalls(np.zeros((0, 3)), np.zeros(0))

    @staticmethod
    def of(mesh: Mesh, surface: Surface) -> ThinWalls:
        """Those of a closed mesh that are an appreciable share of it, largest first; none of an open one."""
        if not mesh.is_closed:
            return ThinWalls.none()
        points, faces = places_on(mesh, ASKED_PLACES, np.random.default_rng(0))
        normals = mesh.face_normals[faces]
        thickness = thickness_at(points, normals, surface, MAX_THICKNESS_DIAGONALS * surface.diagonal)
        thin = np.isfinite(thickness)
        return _grouped(normals[thin], thickness[thin])


def thickness_at(points: FloatArray, normals: FloatArray, surface: Surface, thickest: float) -> FloatArray:
    """Thickness behind places with normals, (n, 3), of a surface, (n,); infinite where no opposed face is so near.

    It is the diameter of the ball inside that touches the place and another one, by shrinking it (Ma, Bae and Choi
    2012).
    """
    radius = np.full(len(points), 0.5 * thickest)
    thickness = np.full(len(points), np.inf)
    rows, before = np.arange(len(points)), normals
    for _ in range(BALL_ROUNDS):
        if not len(rows):
            break
        found = surface.closest(points[rows] - radius[rows, None] * normals[rows])
        touches = found.distances >= (1.0 - CONTACT_TOLERANCE) * radius[rows]
        # At first the ball touches the place alone, whose normal looks its own way.
        opposed = touches & (row_dots(before, normals[rows]) < -np.cos(OPPOSITE_RAD))
        thickness[rows[opposed]] = 2.0 * radius[rows[opposed]]
        rows, away = rows[~touches], points[rows[~touches]] - found.points[~touches]
        before = found.normals[~touches]
        depth = row_dots(away, normals[rows])
        radius[rows] = np.minimum(radius[rows], row_dots(away, away) / np.maximum(2.0 * depth, np.finfo(float).tiny))
    return thickness


def _grouped(normals: FloatArray, thickness: FloatArray) -> ThinWalls:
    """Places by what they have in common, the most frequent first."""
    alike = normals @ normals.T > np.cos(SAME_DIRECTION_RAD)
    alike &= np.abs(thickness[:, None] - thickness) <= THICKNESS_TOLERANCE * thickness[:, None]
    found: list[tuple[FloatArray, float]] = []
    left = np.ones(len(normals), dtype=bool)
    while left.any():
        counts = np.where(left, np.count_nonzero(alike & left, axis=1), 0)
        members = alike[counts.argmax()] & left
        if counts.max() < MIN_WALL_SHARE * ASKED_PLACES:
            break
        mean = normals[members].mean(axis=0)
        found.append((mean / np.linalg.norm(mean), float(np.median(thickness[members]))))
        left &= ~members
    return ThinWalls(np.array([n for n, _ in found]).reshape(-1, 3), np.array([t for _, t in found]))
