"""The axis and the step of a turntable, from the screws of the motions between its views."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.edges import Edge
from dqreg.rigid import DualQuaternion, pose

# Screws that agree: angle between axes, difference of the steps, and distance of the axes in sizes of the motion.
AXIS_RAD, STEP_RAD, APART = np.deg2rad(6.0), np.deg2rad(6.0), 0.1
# Agreeing pairs, at least: two may agree by chance.
FEWEST = 3


@dataclasses.dataclass(frozen=True)
class Table:
    """A turntable: each view is the one before it, turned by one step about the axis."""

    step: DualQuaternion  # The motion T_k_(k+1) between neighbouring views, as one screw
    agreeing: int  # Pairs that it follows from

    def between(self, i: int, j: int) -> FloatArray:
        """T_i_j that the table says of two places in the order, (4, 4)."""
        return (self.step ** float(j - i)).as_matrix()

    @property
    def step_deg(self) -> float:
        """Angle of a step, degrees."""
        return float(np.rad2deg(self.step.as_screw().angle_rad))


def step_of(steps: Sequence[tuple[int, Edge]], count: int) -> Table | None:
    """The step that most pairs of neighbours agree on; None where fewer than three do.

    ``steps`` are the numbers of places from target to source, with their edges. Each neighbour's motion is a
    hypothesis; those that agree with the best are averaged as dual quaternions, each by its verdict.
    """
    single = [edge.registration.T_target_source for n, edge in steps if n == 1 and edge.found]
    single += [pose.inverse(edge.registration.T_target_source) for n, edge in steps if n == -1 and edge.found]
    # The last view's neighbour is the first one, where the table went all the way round.
    single += [pose.inverse(e.registration.T_target_source) for n, e in steps if n == count - 1 > 1 and e.found]
    if len(single) < FEWEST:
        return None
    motions = np.array(single)
    size = float(np.median(np.linalg.norm(motions[:, :3, 3], axis=1))) + np.finfo(float).tiny
    best: list[int] = []
    for guess in motions:
        turned = pose.angle_between(motions, guess)
        shifted = np.linalg.norm(motions[:, :3, 3] - guess[:3, 3], axis=1)
        agrees = np.flatnonzero((np.asarray(turned) <= STEP_RAD) & (shifted <= APART * size + AXIS_RAD * size))
        best = agrees.tolist() if len(agrees) > len(best) else best
    if len(best) < FEWEST:
        return None
    return Table(mean_motion(motions[best]), len(best))


def mean_motion(motions: FloatArray) -> DualQuaternion:
    """The motion in the middle of several close ones: mean of their dual quaternions, back on the constraints."""
    all_of_them = [DualQuaternion.from_matrix(T) for T in motions]
    first = all_of_them[0]
    signs = [1.0 if float(dq.real @ first.real) >= 0.0 else -1.0 for dq in all_of_them]
    real = np.mean([sign * dq.real for sign, dq in zip(signs, all_of_them, strict=True)], axis=0)
    dual = np.mean([sign * dq.dual for sign, dq in zip(signs, all_of_them, strict=True)], axis=0)
    length = float(np.linalg.norm(real))
    real, dual = real / length, dual / length
    return DualQuaternion(real, dual - float(real @ dual) * real)
