"""From the end of a run to the answer: back to the caller's frames, with the evidence and the verdict."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Scan, Surface
from dqreg.icp import ESTIMATORS, InlierMixture, Plan, Run, correspond
from dqreg.icp.history import Iteration
from dqreg.icp.noise_by_face import weighed_by_faces
from dqreg.icp.rejectors import beyond_border
from dqreg.registration.constraints import Known
from dqreg.registration.evidence import gather_evidence, has_pose
from dqreg.registration.inputs import Inputs
from dqreg.registration.result import Registration
from dqreg.registration.source import CentredSource
from dqreg.registration.target_index import TargetIndex
from dqreg.rigid import pose
from dqreg.trust import (
    Evidence,
    Information,
    covariance_of,
    information_of,
    judge,
    observe_directions,
    without_free_motion,
)
from dqreg.trust.records import Alternative, Direction

# Share of the inliers that must remain where a free motion is taken back.
STAYS = 0.99


def to_work(T_target_source: FloatArray, origin_target: FloatArray, origin_source: FloatArray) -> FloatArray:
    """The same motion between the centred frames."""
    R, t = T_target_source[:3, :3], T_target_source[:3, 3]
    return pose.from_parts(R, R @ origin_source + t - origin_target)


def from_work(T_work: FloatArray, origin_target: FloatArray, origin_source: FloatArray) -> FloatArray:
    """Inverse of `to_work`."""
    R, t = T_work[:3, :3], T_work[:3, 3]
    return pose.from_parts(R, t + origin_target - R @ origin_source)


def for_caller(record: Iteration, origin_target: FloatArray, origin_source: FloatArray) -> Iteration:
    """A record of the loop with its pose between the caller's frames."""
    T = from_work(record.T_target_source, origin_target, origin_source)
    return dataclasses.replace(record, T_target_source=T)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a registration ended with, in the centred frames."""

    run: Run
    mixture: InlierMixture
    scan: Scan
    surface: Surface
    source: CentredSource
    target: TargetIndex
    plan: Plan
    known: Known = Known()
    searched: str = ""

    @property
    def found(self) -> bool:
        """Whether there is a pose to speak of."""
        return has_pose(self.run)

    def registration(
        self,
        alternatives: tuple[Alternative, ...],
        timings: dict[str, float],
        settings: dict[str, Any],
        keep_inputs: bool = False,
        mirror_gain: float = -np.inf,
    ) -> Registration:
        """The answer in the caller's frames."""
        information = self.information if self.found else None
        directions = observe_directions(information) if information else ()
        T = np.full((4, 4), np.nan)
        if self.found:
            T = from_work(self.run.T_target_source, self.target.origin, self.source.origin)
        weights, pairs = self.run.weights, self.run.pairs
        return Registration(
            T_target_source=T,
            verdict=judge(self._complete(directions, alternatives, settings.get("target_units"), mirror_gain)),
            status=self.run.status,
            covariance=covariance_of(information) if information else np.full((6, 6), np.nan),
            observability=directions,
            alternatives=alternatives,
            history=tuple(for_caller(record, self.target.origin, self.source.origin) for record in self.run.history),
            rms=float(np.sqrt(weights @ pairs.squares / weights.sum())) if self.found else np.nan,
            inlier_fraction=float(weights.sum() / pairs.scan.represented) if self.found else 0.0,
            timings=timings,
            settings={**settings, **self._resolved()},
            inputs=Inputs(self.source, self.target) if keep_inputs else None,
        )

    def with_free_motions_of(self, start: FloatArray) -> Outcome:
        """The same with the motions that nothing holds as the start had them."""
        if not self.found or self.known.anything or not self.information.free.any():
            return self
        T = without_free_motion(self.run.T_target_source, start, self.information)
        pairs = correspond(self.run.pairs.scan, self.surface, T)
        weights = np.where(self.run.weights > 0.0, self.mixture.weight(pairs.distances), 0.0)
        if pairs.scan.counts is not None:
            weights *= pairs.scan.counts
        if weights.sum() < STAYS * self.run.weights.sum():
            return self
        return dataclasses.replace(
            self, run=dataclasses.replace(self.run, T_target_source=T, pairs=pairs, weights=weights)
        )

    @cached_property
    def information(self) -> Information:
        """What the matches hold, and how well."""
        pairs = self.run.pairs
        points = pose.apply(self.run.T_target_source, pairs.scan.points)
        normals, surface, scan = pairs.closest.normals, self.surface, pairs.scan
        along = np.einsum("ij,ij->i", points - pairs.closest.points, normals)
        lever = 0.5 * surface.diagonal
        weights = self.run.weights
        if self.plan.fine is not None and self.plan.fine is not ESTIMATORS["generalised"]:
            weights = weighed_by_faces(pairs, weights, self.mixture.scale)
        smooth = self.target.smooth_normals(pairs.closest)
        held = information_of(
            points,
            normals,
            along,
            weights,
            lever,
            np.zeros(3),
            smooth,
            patchwise=True,
            counts=scan.counts,
            scattered=scan.scatter,
            allowed=self.known.allowed(self.run.T_target_source),
            prior=self.known.information(self.run.T_target_source),
        )
        # The words name places in the caller's frame.
        return dataclasses.replace(held, centre=self.target.origin)

    def _complete(
        self,
        directions: tuple[Direction, ...],
        alternatives: tuple[Alternative, ...],
        units: str | None,
        mirror_gain: float,
    ) -> Evidence:
        return dataclasses.replace(
            self.evidence, directions=directions, alternatives=alternatives, units=units, mirror_gain=mirror_gain
        )

    @cached_property
    def evidence(self) -> Evidence:
        """What speaks for and against the pose, but for what is held and for other poses."""
        surface = self.surface
        return gather_evidence(
            self.run,
            self.mixture,
            self.scan,
            surface,
            self.plan,
            (),
            (),
            self.searched,
            has_border=not (isinstance(self.target.geometry, Mesh) and self.target.geometry.is_closed),
        )

    def _beyond_border(self) -> int:
        if not self.found:
            return 0
        out = beyond_border(self.run.pairs, self.surface, self.mixture.scale, self.plan.max_distance)
        return int(np.count_nonzero(out))

    def _resolved(self) -> dict[str, Any]:
        return {
            "max_distance": self.plan.max_distance,
            "width": self.mixture.scale,
            "source_noise": self.scan.noise,
            "source_spacing": self.scan.spacing,
            "source_points": self.scan.total,
            "source_dropped": self.source.cloud.dropped,
            "source_scale": self.source.scale,
            "used_points": round(self.run.pairs.scan.represented),
            "beyond_border": self._beyond_border(),
            "normals_oriented": self.run.pairs.same_sign,
            "target_kind": self.target.kind,
            "target_dropped": self.target.geometry.dropped,
            "diagonal": self.surface.diagonal,
            "centre": self.target.origin.tolist(),
        }
