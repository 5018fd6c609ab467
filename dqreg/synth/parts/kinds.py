"""The parts by name, each with its symmetry."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose
from dqreg.rigid.symmetry import Axis, Symmetry
from dqreg.synth.parts.blade import blade
from dqreg.synth.parts.blocks import block, feeder, prism
from dqreg.synth.parts.bracket import bracket
from dqreg.synth.parts.plain import Mesh, box, cylinder, plate
from dqreg.synth.parts.sheet import angle
from dqreg.synth.parts.turned import flange, gear

_ROUND_Z = (Axis(np.array([0.0, 0.0, 1.0]), np.zeros(3), None),)
_NONE = np.zeros((0, 4, 4))


@dataclass(frozen=True)
class PartKind:
    """How a part of one kind is made, and its symmetry."""

    build: Callable[..., Mesh]  # Takes the dimensions as keywords; returns vertices (v, 3) and faces (f, 3)
    # Takes all dimensions by name, defaults filled in; returns a `Symmetry`
    symmetry: Callable[[Mapping[str, Any]], Symmetry]


def symmetry_of(kind: str, dimensions: Mapping[str, Any] | None = None) -> Symmetry:
    """Motions that put a part of one kind onto itself."""
    bound = inspect.signature(KINDS[kind].build).bind(**(dimensions or {}))
    bound.apply_defaults()
    return KINDS[kind].symmetry(bound.arguments)


def about_z(order: int, *, flips: bool = False) -> FloatArray:
    """Rotations about the z axis by equal steps, and half-turns about axes across it.

    Shapes: returns (order or 2 order, 4, 4).
    """
    turn = np.arange(order) * (2.0 * np.pi / order)
    T = np.broadcast_to(np.eye(4), (order, 4, 4)).copy()
    T[:, 0, 0] = T[:, 1, 1] = np.cos(turn)
    T[:, 1, 0], T[:, 0, 1] = np.sin(turn), -np.sin(turn)
    return np.concatenate([T, T @ np.diag([1.0, -1.0, -1.0, 1.0])]) if flips else T


def of_box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> FloatArray:
    """Rotations that put a rectangular block onto itself. Shapes: returns (4, 8 or 24, 4, 4)."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0.0 and all(size[i] == size[order[i]] for i in range(3)):
                found.append(pose.about(pose.from_parts(R, np.zeros(3)), np.asarray(centre, dtype=np.float64)))
    return np.stack(found)


def _exact(poses: FloatArray, axes: tuple[Axis, ...] = ()) -> Symmetry:
    return Symmetry(poses, _NONE, axes)


def _of_plate(given: Mapping[str, Any]) -> Symmetry:
    poses = of_box(given["size"], [0.5 * s for s in given["size"]])
    # Rotations that move z off z are of a cube; the holes run along z.
    poses = poses[np.abs(poses[:, 2, 2]) == 1.0]
    if given["large_hole"] == given["small_hole"]:
        return _exact(poses)
    # One larger hole near the origin: only the half-turn about the diagonal through it can leave it in its place.
    centre = 0.25 * np.asarray(given["size"], dtype=np.float64)
    centre[2] = 0.5 * given["size"][2]
    moved = poses[:, :3, :3] @ centre + poses[:, :3, 3]
    same = np.linalg.norm(moved - centre, axis=1) < 1e-9 * max(given["size"])
    return Symmetry(poses[same], poses[~same])


def _without(_given: Mapping[str, Any]) -> Symmetry:
    return Symmetry(np.eye(4)[None], _NONE)


def _of_block(given: Mapping[str, Any]) -> Symmetry:
    poses = of_box(given["size"])
    corner = np.ones(3)
    same = np.abs(poses[:, :3, :3] @ corner - corner).max(axis=1) < 1e-9
    return Symmetry(poses[same], poses[~same])


def _of_prism(given: Mapping[str, Any]) -> FloatArray:
    # A prism of four sides can be a cube, if its height is the side.
    if given["sides"] == 4 and np.isclose(given["height"], given["diameter"] / np.sqrt(2.0), rtol=1e-9):
        turn = about_z(8)[1]
        poses: FloatArray = turn @ of_box((1, 1, 1)) @ turn.T
        return poses
    return about_z(given["sides"], flips=True)


KINDS: Mapping[str, PartKind] = {
    "angle": PartKind(angle, _without),
    "blade": PartKind(blade, _without),
    "block": PartKind(block, _of_block),
    "box": PartKind(box, lambda given: _exact(of_box(given["size"]))),
    "bracket": PartKind(bracket, _without),
    "cylinder": PartKind(cylinder, lambda given: _exact(about_z(1, flips=True), _ROUND_Z)),
    "feeder": PartKind(feeder, _without),
    "flange": PartKind(flange, lambda given: _exact(about_z(given["bolts"]))),
    "gear": PartKind(gear, lambda given: _exact(about_z(given["teeth"]))),
    "plate": PartKind(plate, _of_plate),
    "prism": PartKind(prism, lambda given: _exact(_of_prism(given))),
}
