"""Constraints on the pose: locked motions, and a pose known beforehand with its covariance."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.icp import Estimator, constrained
from dqreg.icp.noise_by_face import Weigher
from dqreg.registration.constrained_motions import held_by_shape
from dqreg.rigid import pose
from dqreg.solvers import Freedom, PoseCost


@dataclasses.dataclass(frozen=True)
class PoseConstraints:
    """Locked motions and a prior, between the centred frames."""

    freedom: Freedom | None = None  # Motions that are allowed; None allows all
    reference: FloatArray | None = None  # (4, 4): Pose that the locked motions keep; needed with ``freedom``
    prior: PoseCost | None = None  # Pose known beforehand

    @staticmethod
    def centred(
        freedom: Freedom | None,
        prior: Any,
        reference: FloatArray,
        origin_source: FloatArray,
        origin_target: FloatArray,
    ) -> PoseConstraints:
        """What was given in the caller's frames, between the centred ones; the reference is given there already."""
        freedom = None if freedom is None else freedom.recentred(origin_target)
        if prior is None:
            return PoseConstraints(freedom, reference)
        try:
            T, covariance = prior
            if isinstance(prior, str):
                raise TypeError("text")
        except (TypeError, ValueError):
            raise InputError(f"prior must be (pose, covariance), a 4x4 and a 6x6; got {type(prior).__name__}") from None
        # Turned about the middle of the target, as the covariance of a `Registration` is.
        middle = pose.from_parts(np.eye(3), origin_target)
        return PoseConstraints(
            freedom, reference, PoseCost.prior(T, covariance, middle).recentred(origin_source, origin_target)
        )

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return self.freedom is not None or self.prior is not None

    def estimator(self, *, planes: bool, weighed_by: Weigher | None = None) -> Estimator:
        """Estimator that keeps them, see `constrained`; with weights by the scatter of faces, if so asked."""
        if self.reference is None:
            raise InputError("locked motions and priors need a start to hold the pose to")
        held = constrained(
            self.freedom or Freedom.parse("all"), self.reference, self.prior, planes=planes, held_of=held_by_shape
        )
        if weighed_by is None:
            return held
        return lambda pairs, weights, noise: held(pairs, weighed_by(pairs, weights, noise), noise)

    def project(self, T: FloatArray) -> FloatArray:
        """The pose with its locked motions exactly as they were: an early end may hold an extrapolated one."""
        if self.freedom is None or self.reference is None:
            return T
        return self.freedom.project(T, self.reference)

    def allowed(self, T: FloatArray) -> FloatArray | None:
        """Twists about the origin that the pose may take, (6, k); None for all six."""
        if self.freedom is None or self.reference is None:
            return None
        return self.freedom.twists(T, self.reference)

    def information(self, T: FloatArray) -> FloatArray | None:
        """Information of the prior about the twist, (6, 6); None without one."""
        return None if self.prior is None else self.prior.information(T)

    def prior_sigmas(self, T: FloatArray) -> float:
        """How far the prior's pose is from one that weighs it with a scan, in its standard deviations; 0 without one.

        From the scan's own it is farther: those are as sure as the distances, which grow where the two contradict.
        """
        return 0.0 if self.prior is None else math.sqrt(max(self.prior.value(T), 0.0))
