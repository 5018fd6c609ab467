"""The last stage over sums of chunks: steps of Newton and EM in turn, whoever measures."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.batch.sums import Question, Sums
from dqreg.records import Iteration
from dqreg.rigid import pose

if TYPE_CHECKING:
    from dqreg.geometry import Scan, Surface
    from dqreg.icp import InlierMixture

# A step that moves the points by less than that share of the target's size is the last, once the width has settled to
# that share of itself. Further on a point on an edge may hop between two faces for ever: 4e-9 sizes a step were seen.
TOLERANCE, SETTLED = 1e-8, 1e-4
# Steps at most, and steps without a shorter one; from a pose that is right to the noise three will do.
STEPS, PATIENCE = 60, 5
STAGE = "huge"


@dataclasses.dataclass(frozen=True)
class End:
    """Where the stage ended, between the centred frames.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Last pose.
    history : tuple of Iteration
        One record a step.
    status : str
        "converged", "stalled", "iteration limit" or "no correspondences".
    """

    T_target_source: FloatArray
    history: tuple[Iteration, ...]
    status: str


class Stage:
    """The last stage.

    Parameters
    ----------
    scan : Scan
        All points, for their spread and noise.
    surface : Surface
        The target, for its size.
    ask : callable
        From a question to the sums of all chunks.
    """

    def __init__(self, scan: Scan, surface: Surface, ask: Callable[[Question], Sums]) -> None:
        from dqreg.icp import width_floor
        from dqreg.icp.loop import Spread

        self._ask, self._size = ask, surface.diagonal
        self._floor = width_floor(scan, surface)
        self._spread, self._noise = Spread.of(scan.points), scan.noise

    def descend(self, T: FloatArray, mixture: InlierMixture, angle_rad: float, count: int) -> End:
        """Step until neither pose nor width moves.

        Parameters
        ----------
        T : ndarray, (4, 4)
            Pose to begin with, between the centred frames.
        mixture : InlierMixture
            Kernel to begin with.
        angle_rad : float
            Largest angle between normals.
        count : int
            Iterations made before.

        Returns
        -------
        End
            Pose, records and status.
        """
        from dqreg.icp import Stopping
        from dqreg.icp.face_noise import MISFIT
        from dqreg.solvers.pose_newton import minimise
        from dqreg.solvers.quadratic import QuadraticForm

        stopping = Stopping(TOLERANCE, STEPS, PATIENCE)
        history: list[Iteration] = []
        faces: FloatArray | None = None
        floor = min(self._floor, mixture.scale)
        while True:
            began = time.perf_counter()
            middle = self._spread.mean
            origins = (middle, pose.apply(T, middle[None])[0])
            sums = self._ask(Question(T, mixture, angle_rad, origins, faces))
            if not sums.weight > 0.0:
                return End(T, tuple(history), "no correspondences")
            T_next = minimise(QuadraticForm(sums.matrix, *origins), T)
            learned = _learned(mixture, sums, floor)
            weighed = learned.scale <= MISFIT * self._noise
            settled = (faces is not None) == weighed and abs(learned.scale - mixture.scale) <= SETTLED * mixture.scale
            history.append(self._record(count + len(history) + 1, sums, mixture, T, T_next, began))
            T, mixture, faces = T_next, learned, sums.faces if weighed else None
            status = stopping.status([each.motion for each in history])
            if status is not None and (settled or status != "converged"):
                return End(T, tuple(history), status)

    def _record(
        self, number: int, sums: Sums, mixture: InlierMixture, T: FloatArray, T_next: FloatArray, began: float
    ) -> Iteration:
        return Iteration(
            number=number,
            stage=STAGE,
            points=sums.points,
            pairs=sums.pairs,
            inlier_fraction=sums.weight / sums.points,
            rms=float(np.sqrt(sums.squared / sums.weight)),
            scale=mixture.scale,
            energy=sums.cost / sums.points,
            turn_rad=float(pose.angle_between(T, T_next)),
            motion=self._spread.motion(T, T_next) / self._size,
            seconds=time.perf_counter() - began,
            T_target_source=T_next,
        )


def _learned(mixture: InlierMixture, sums: Sums, floor: float) -> InlierMixture:
    """One round of EM from sums, as `InlierMixture.learned` does from distances."""
    from dqreg.icp.kernels import LEAST_SHARE

    scale = max(float(np.sqrt(sums.squared / sums.weight)), floor, float(np.finfo(float).tiny))
    share = float(np.clip(sums.weight / sums.near, LEAST_SHARE, 1.0 - LEAST_SHARE))
    return dataclasses.replace(mixture, scale=scale, share=share)
