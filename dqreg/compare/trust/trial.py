"""One task carried out and judged: was the pose right, and what did the verdict say."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust.task import Drive, Kind, TrustTask
from dqreg.errors import DqregError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.rigid import pose
from dqreg.synth.truth import closest_truth, displacements

if TYPE_CHECKING:
    from dqreg.registration.result.result import Registration
    from dqreg.trust.records import Direction

# A pose is right if no point of the part is displaced by more than this share of its diagonal.
MAX_ERROR_DIAGONALS = 0.02
# Another pose is as right if nearly all of the part comes to lie on itself: within so many standard deviations of the
# noise, but for so small a share.
SAME_SIGMAS, SAME_SHARE = 3.0, 0.995
# Points of the part that are looked at for that.
COMPARED_POINTS = 3000
# Points that lie on faces turned the same way: at edges the nearest face is either.
SAME_SIDE_SHARE = 0.9
# Frames of a good drive that must be accepted.
MIN_ACCEPTED_SHARE = 0.9


@dataclasses.dataclass(frozen=True)
class Trial:
    """What came of one task."""

    kind: str
    seed: int
    good: bool
    level: str  # Of the verdict; "error" where an error was raised
    right: bool  # Whether the pose is right; False where no pose is, or none was found
    error: float  # Worst displacement in diagonals (of a drive: metres); NaN where no pose is right, or none was found
    codes: tuple[str, ...]  # Of the verdict's reasons
    reason: str  # The first reason in words
    points: int
    seconds: float
    confidence: float = float("nan")  # What the verdict gives as the probability of a right pose
    figures: tuple[float, ...] = ()  # Of the evidence, in the order of `dqreg.trust.confidence.figures_of`
    named: bool | None = None  # Whether the equally good poses stand in the alternatives; None where there are none

    @property
    def wrong_accept(self) -> bool:
        """Whether a wrong pose was accepted."""
        return self.level == "accepted" and not self.right


def trial(kind: Kind, seed: int) -> Trial:
    """Carry out the task of a seed."""
    task = kind.task(seed)
    return _driven(kind, seed, task) if isinstance(task, Drive) else _registered(kind, seed, task)


def _registered(kind: Kind, seed: int, task: TrustTask) -> Trial:
    from dqreg.registration.register import register

    began = time.perf_counter()
    try:
        result = register(task.source, task.target, task.start, **task.options)
    except DqregError as error:
        seconds = time.perf_counter() - began
        words = f"{type(error).__name__}: {error}"
        return Trial(kind.name, seed, kind.good, "error", False, np.nan, (), words, len(task.source), seconds)
    seconds = time.perf_counter() - began
    right, off = is_right(result.T_target_source, task)
    verdict = result.verdict
    return Trial(
        kind=kind.name,
        seed=seed,
        good=kind.good,
        level=verdict.level,
        right=right,
        error=off,
        codes=verdict.codes,
        reason=str(verdict.reasons[0]),
        points=len(task.source),
        seconds=seconds,
        confidence=verdict.confidence,
        figures=tuple(verdict._figures.values()),
        named=_names_rivals(result, task) if len(task.rivals) else None,
    )


def is_right(T: FloatArray, task: TrustTask) -> tuple[bool, float]:
    """Whether a pose is right, and its worst displacement in diagonals."""
    if not len(task.truths) or not np.isfinite(T).all():
        return False, np.nan
    truth = closest_truth(T, task.truths, task.probes, None)
    off = float(displacements(T, truth, task.probes).max()) / task.size
    motion = T @ pose.inverse(truth)
    is_near = off <= MAX_ERROR_DIAGONALS and not _on_another_side(motion, task)
    return is_near or _onto_itself(motion, task), off


def _on_another_side(motion: FloatArray, task: TrustTask) -> bool:
    """Whether a motion displaces some wall by more than half of its thickness across it."""
    if task.walls is None:
        return False
    displaced = pose.apply(motion, task.walls.points) - task.walls.points
    return bool(np.abs(np.einsum("ij,ij->i", displaced, task.walls.normals)).max() > 0.5 * task.walls.thickness)


def _onto_itself(motion: FloatArray, task: TrustTask) -> bool:
    """Whether the part comes to lie on itself, as far as the noise can tell."""
    if not isinstance(task.target, Mesh):
        return False
    points = sample_mesh(task.target, COMPARED_POINTS, np.random.default_rng(0)).points
    away = MeshSurface(task.target).closest(pose.apply(motion, points)).distances
    return bool(np.quantile(away, SAME_SHARE) <= SAME_SIGMAS * task.noise)


def _names_rivals(result: Registration, task: TrustTask) -> bool:
    """Whether a pose that fits as well and is another one than the answer is named.

    Such poses are those of the task, and those that its motions lead to from the answer: a period farther on. Where
    they form no group, as corners of a block, the answer may be any of them. A pose is one as well where the scan lies
    on the part as it does at a right one: two periods farther on, or on another wall, where it shows walls only. One is
    named as an alternative, or with all others along motions that are said to be unconstrained: of a scan of one wall
    of stairs, a step is one of them.
    """
    T, limit = result.T_target_source, MAX_ERROR_DIAGONALS * task.size
    if not np.isfinite(T).all():
        return False
    equals = np.concatenate([task.equals, task.rivals @ T])
    if any(_along_free_motions(T, equal, result.observability, task.probes, limit) for equal in equals):
        return True
    others = [
        other.T_target_source
        for other in result.alternatives
        if displacements(other.T_target_source, T, task.probes).max() > limit
    ]
    return any(displacements(other, equal, task.probes).max() <= limit for other in others for equal in equals) or any(
        _lies_alike(other, task) for other in others
    )


def _lies_alike(T: FloatArray, task: TrustTask) -> bool:
    """Whether the scan lies on the part at a pose as at a right one, outer side out, as far as its noise can tell."""
    if not isinstance(task.target, Mesh):
        return False
    surface = MeshSurface(task.target)
    here, there = (surface.closest(pose.apply(each, task.source)) for each in (T, task.equals[0]))
    on = [np.mean(each.distances <= SAME_SIGMAS * task.noise) for each in (here, there)]
    turned = there.normals @ (T @ pose.inverse(task.equals[0]))[:3, :3].T
    outward = np.mean(np.einsum("ij,ij->i", turned, here.normals) > 0.0)
    return bool(on[0] >= on[1] - (1.0 - SAME_SHARE) and outward >= SAME_SIDE_SHARE)


def _along_free_motions(
    T: FloatArray, other: FloatArray, motions: Sequence[Direction], probes: FloatArray, limit: float
) -> bool:
    """Whether motions that are named as free lead from one pose to another, by displacements of the probes (n, 3)."""
    free = [motion for motion in motions if motion.is_free]
    displaced = pose.apply(other @ pose.inverse(T), probes) - probes
    if not free or np.linalg.norm(displaced, axis=1).max() <= limit:
        return False
    along = [
        np.cross(motion.axis, probes - motion.point)
        if motion.kind == "rotation"
        else np.tile(motion.axis, (len(probes), 1))
        for motion in free
    ]
    fields = np.stack(along).reshape(len(free), -1)
    left = displaced.ravel() - np.linalg.lstsq(fields.T, displaced.ravel(), rcond=None)[0] @ fields
    return bool(np.linalg.norm(left.reshape(-1, 3), axis=1).max() <= limit)


def _driven(kind: Kind, seed: int, task: Drive) -> Trial:
    from dqreg.odometry import Odometry

    odometry, began = Odometry(), time.perf_counter()
    results = [odometry.register_frame(points) for points in task.frames]
    seconds = time.perf_counter() - began
    off = np.array(
        [np.linalg.norm(r.T_target_source[:3, 3] - T[:3, 3]) for r, T in zip(results, task.poses, strict=True)]
    )
    right = off <= task.allowed
    accepted = np.array([result.verdict.level == "accepted" for result in results])
    wrongly = accepted & ~right
    is_accepted = bool(wrongly.any()) or (bool(right.all()) and accepted.mean() >= MIN_ACCEPTED_SHARE)
    # The frame that tells most: one wrongly accepted, else the first that was refused.
    shown = int(np.argmax(wrongly) if wrongly.any() else np.argmin(accepted))
    verdict = results[shown].verdict
    return Trial(
        kind=kind.name,
        seed=seed,
        good=kind.good,
        level="accepted" if is_accepted else "suspect",
        right=bool(right.all()),
        error=float(np.nanmax(off)) if np.isfinite(off).any() else np.nan,
        codes=tuple(dict.fromkeys(code for result in results for code in result.verdict.codes if code != "accepted")),
        reason=f"frame {shown}: {verdict.reasons[0]}",
        points=sum(map(len, task.frames)),
        seconds=seconds,
    )
