"""The judge: scores a pose against the ground truth, and knows nothing of whoever found it.

It imports no engine and no registration, neither ours nor a peer's; a test reads its imports. What it gets is a 4x4
matrix; what it says is how far each point of the part is from where it belongs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import RIGID_TOLERANCE, FloatArray, as_float
from dqreg.errors import InputError
from dqreg.geometry import Surface
from dqreg.rigid import pose
from dqreg.synth.truth import closest_truth, displacements

# A pose is a success if no point of the part is farther from its true place than this fraction of the part's diagonal:
# another convergence basin is farther, noise and sampling are nearer.
SUCCESS_THRESHOLD = 0.01

Kind = Literal["rigid", "mirrored", "not rigid", "nothing"]


@dataclasses.dataclass(frozen=True, eq=False)
class GroundTruth:
    """What the judge knows of a task, and no engine is told."""

    # (v, 3): Points of the part, target frame, whose displacement is measured: the vertices of a mesh
    probes: FloatArray
    size: float  # S, the diagonal of the target's bounding box
    # (k, 4, 4): True poses ``T_target_source``; more than one where the part is symmetric, none where no truth is known
    truths: FloatArray
    # (2, 3): Point and direction of the axis of a part of revolution, target frame: any rotation about it is true
    axis: FloatArray | None = None
    # (h, 3): Scan points that no engine was given, source frame
    held_out: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    surface: Surface | None = None  # The target, to measure the held-out points against
    gate: float = 0.0  # Distance up to which a held-out point counts as lying on the target
    success_threshold: float = SUCCESS_THRESHOLD  # Largest worst displacement, in S, of a pose that counts as found


@dataclasses.dataclass(frozen=True)
class Score:
    """What a pose is worth; lengths in the target's unit, NaN where there is nothing to measure."""

    kind: Kind  # What was handed in. Only a rigid pose can succeed
    success: bool | None  # Whether the pose is within the success threshold; None where no truth is known
    angle_rad: float  # Angle of the rotation that is left; NaN unless rigid
    offset: float  # Displacement of the middle of the part
    # worst, rms: Greatest and root mean square displacement of the probes
    worst: float
    rms: float
    surface_rms: float  # Root mean square distance of the held-out points that lie on the target
    overlap: float  # Fraction of the held-out points that lie on the target


def judge(T_target_source: ArrayLike, ground_truth: GroundTruth) -> Score:
    """Score a pose."""
    T = as_float(T_target_source, "T_target_source")
    if T.shape != (4, 4):
        raise InputError(f"T_target_source must be 4x4; got shape {T.shape}")
    kind = kind_of(T)
    nan = float("nan")
    if kind == "nothing":
        return Score(kind, False if len(ground_truth.truths) else None, *(nan,) * 5, 0.0)
    surface_rms, overlap = _on_surface(T, ground_truth)
    if not len(ground_truth.truths):
        return Score(kind, None, *(nan,) * 4, surface_rms, overlap)
    truth = _closest_truth(T, ground_truth)
    moved = displacements(T, truth, ground_truth.probes)
    worst = float(moved.max())
    return Score(
        kind=kind,
        success=kind == "rigid" and worst <= ground_truth.success_threshold * ground_truth.size,
        angle_rad=float(pose.angle_between(T, truth)) if kind == "rigid" else nan,
        offset=float(displacements(T, truth, _middle(ground_truth.probes)[None])[0]),
        worst=worst,
        rms=float(np.sqrt(np.mean(moved**2))),
        surface_rms=surface_rms,
        overlap=overlap,
    )


def worst_along(poses: Iterable[ArrayLike], ground_truth: GroundTruth) -> FloatArray:
    """Worst displacement of each intermediate pose, for a convergence curve."""
    return np.array([_worst(as_float(T, "pose"), ground_truth) for T in poses], dtype=np.float64)


def kind_of(T: FloatArray) -> Kind:
    """What a 4x4 matrix is."""
    if not np.isfinite(T).all():
        return "nothing"
    R = T[:3, :3]
    # Numbers near float64's limit overflow to infinity or NaN, and neither is within the tolerance.
    with np.errstate(over="ignore", invalid="ignore"):
        gap = np.abs(R.T @ R - np.eye(3)).max()
        orthonormal = bool(gap <= RIGID_TOLERANCE) and np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], atol=RIGID_TOLERANCE)
        if not orthonormal:
            return "not rigid"
    return "rigid" if np.linalg.det(R) > 0.0 else "mirrored"


def _worst(T: FloatArray, ground_truth: GroundTruth) -> float:
    if not len(ground_truth.truths) or kind_of(T) == "nothing":
        return float("nan")
    return float(displacements(T, _closest_truth(T, ground_truth), ground_truth.probes).max())


def _closest_truth(T: FloatArray, ground_truth: GroundTruth) -> FloatArray:
    return closest_truth(T, ground_truth.truths, ground_truth.probes, ground_truth.axis)


def _on_surface(T: FloatArray, ground_truth: GroundTruth) -> tuple[float, float]:
    if ground_truth.surface is None or not len(ground_truth.held_out):
        return float("nan"), float("nan")
    moved = ground_truth.held_out @ T[:3, :3].T + T[:3, 3]
    distances = ground_truth.surface.closest(moved).distances
    near = distances[distances <= ground_truth.gate]
    rms = float(np.sqrt(np.mean(near**2))) if len(near) else float("nan")
    return rms, len(near) / len(distances)


def _middle(points: FloatArray) -> FloatArray:
    middle: FloatArray = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle
