"""Distances of points from ideal shapes, with derivatives, in a frame that moves with the shape."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import twist

FeatureKind = Literal["plane", "line", "circle", "cylinder", "cone", "sphere", "slot"]


@dataclasses.dataclass(frozen=True)
class Shape:
    """An ideal shape: a point of it or of its axis, a frame whose third column is its normal or axis, and its size."""

    point: FloatArray  # (3,)
    frame: FloatArray  # (3, 3): A rotation; columns are the local axes
    radius: float = 0.0  # Of a cone: at `point`
    half_angle: float = 0.0  # Of a cone: its radius grows along the axis by the tangent of it; radians
    # Of a slot: half the distance between the axes of its round ends, which lie along the first column
    half_length: float = 0.0

    @property
    def axis(self) -> FloatArray:
        """Normal or axis, (3,)."""
        return self.frame[:, 2]

    def local(self, points: FloatArray) -> FloatArray:
        """Points in the frame of the shape, (n, 3)."""
        return (points - self.point) @ self.frame

    def moved(self, kind: FeatureKind, step: FloatArray) -> Shape:
        """The shape after a step along its parameters, see `PARAMETERS`."""
        change = dict(zip(PARAMETERS[kind], step.tolist(), strict=True))
        tilt = np.array([change.get(f"tilt_{axis}", 0.0) for axis in "xyz"])
        shift = np.array([change.get(f"shift_{axis}", 0.0) for axis in "xyz"])
        return Shape(
            point=self.point + self.frame @ shift,
            frame=self.frame @ twist.exp(np.r_[tilt, 0.0, 0.0, 0.0])[:3, :3],
            radius=self.radius + change.get("radius", 0.0),
            half_angle=self.half_angle + change.get("half_angle", 0.0),
            half_length=max(self.half_length + change.get("half_length", 0.0), 0.0),
        )


# Parameters of each shape, in its own frame: rotations about local x and y in radians, translations, sizes.
PARAMETERS: dict[FeatureKind, tuple[str, ...]] = {
    "plane": ("tilt_x", "tilt_y", "shift_z"),
    "line": ("tilt_x", "tilt_y", "shift_x", "shift_y"),
    "circle": ("tilt_x", "tilt_y", "shift_x", "shift_y", "shift_z", "radius"),
    "cylinder": ("tilt_x", "tilt_y", "shift_x", "shift_y", "radius"),
    "cone": ("tilt_x", "tilt_y", "shift_x", "shift_y", "radius", "half_angle"),
    "sphere": ("shift_x", "shift_y", "shift_z", "radius"),
    "slot": ("tilt_x", "tilt_y", "tilt_z", "shift_x", "shift_y", "radius", "half_length"),
}
ANGLES = frozenset({"tilt_x", "tilt_y", "tilt_z", "half_angle"})
# Points that are needed: one more than the parameters, so that a form error can show; a circle has two rows a point.
FEWEST: dict[FeatureKind, int] = {"plane": 4, "line": 3, "circle": 4, "cylinder": 6, "cone": 7, "sphere": 5, "slot": 8}

Rows = tuple[FloatArray, FloatArray]


def as_displacements(kind: FeatureKind, size: float) -> FloatArray:
    """What a displacement is multiplied with to be a change of each parameter, (k,): angles turn at that size."""
    return np.array([1.0 / size if name in ANGLES else 1.0 for name in PARAMETERS[kind]])


def distances(kind: FeatureKind, shape: Shape, points: FloatArray) -> Rows:
    """Signed distances of points and their derivatives by the parameters. Shapes: (r,), (r, k).

    A line gives its two components, a circle the height over its plane and the distance within it: r = 2 n there.
    """
    return MODELS[kind](shape.local(points), shape)


def _plane(q: FloatArray, shape: Shape) -> Rows:
    return q[:, 2], _height(q)


def _line(q: FloatArray, shape: Shape) -> Rows:
    x, y, z = q.T
    none = np.zeros_like(z)
    one = np.ones_like(z)
    rows = np.stack([none, -z, -one, none], axis=1), np.stack([z, none, none, -one], axis=1)
    return np.concatenate([x, y]), np.concatenate(rows)


def _circle(q: FloatArray, shape: Shape) -> Rows:
    tilt_x, tilt_y, shift_z = _height(q).T
    none = np.zeros_like(shift_z)
    height = np.stack([tilt_x, tilt_y, none, none, shift_z, none], axis=1)
    rho, turn = _radial(q)
    across = np.stack([turn[0], turn[1], turn[2], turn[3], none, -np.ones_like(rho)], axis=1)
    return np.concatenate([q[:, 2], rho - shape.radius]), np.concatenate([height, across])


def _cylinder(q: FloatArray, shape: Shape) -> Rows:
    rho, turn = _radial(q)
    return rho - shape.radius, np.stack([*turn, -np.ones_like(rho)], axis=1)


def _cone(q: FloatArray, shape: Shape) -> Rows:
    # The nearest line of the cone leans by the half angle: its radius grows along the axis.
    sine, cosine = np.sin(shape.half_angle), np.cos(shape.half_angle)
    rho, (tilt_x, tilt_y, shift_x, shift_y) = _radial(q)
    beyond, z = rho - shape.radius, q[:, 2]
    rows = np.stack(
        [
            cosine * tilt_x + sine * q[:, 1],
            cosine * tilt_y - sine * q[:, 0],
            cosine * shift_x,
            cosine * shift_y,
            np.full_like(z, -cosine),
            -sine * beyond - cosine * z,
        ],
        axis=1,
    )
    return cosine * beyond - sine * z, rows


def _sphere(q: FloatArray, shape: Shape) -> Rows:
    length = np.linalg.norm(q, axis=1)
    unit = q / np.maximum(length, np.finfo(float).tiny)[:, None]
    return length - shape.radius, np.column_stack([-unit, -np.ones_like(length)])


def _slot(q: FloatArray, shape: Shape) -> Rows:
    # Distance from the line between the axes of the ends: the sides are flat where it is met across.
    x, y, z = q.T
    along = np.clip(x, -shape.half_length, shape.half_length)
    u = x - along
    rho = np.hypot(u, y)
    safe = np.maximum(rho, np.finfo(float).tiny)
    a, b = u / safe, y / safe
    rows = np.stack([b * z, -a * z, -b * along, -a, -b, -np.ones_like(rho), -np.abs(a)], axis=1)
    return rho - shape.radius, rows


def _height(q: FloatArray) -> FloatArray:
    # Of q_z by a rotation about local x and y and a translation along z.
    return np.stack([-q[:, 1], q[:, 0], -np.ones(len(q))], axis=1)


def _radial(q: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    # Distance from the local z axis, and its derivatives by both tilts and both shifts.
    rho = np.hypot(q[:, 0], q[:, 1])
    x, y = q[:, 0] / np.maximum(rho, np.finfo(float).tiny), q[:, 1] / np.maximum(rho, np.finfo(float).tiny)
    return rho, (y * q[:, 2], -x * q[:, 2], -x, -y)


MODELS: dict[FeatureKind, Callable[[FloatArray, Shape], Rows]] = {
    "plane": _plane,
    "line": _line,
    "circle": _circle,
    "cylinder": _cylinder,
    "cone": _cone,
    "sphere": _sphere,
    "slot": _slot,
}
