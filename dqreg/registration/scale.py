"""``scale="solve"``: one number from source to target, found and refined together with the pose, because it was asked.

The scale is found on a few thousand points (`scale_search`). Then the source is registered at that scale like any
other, a joint step on the final correspondences corrects scale and pose, and both alternate until the scale is
stationary.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._statuses import INTERRUPTED
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.opening import as_geometry, describe
from dqreg.geometry.unit_check import principal_spreads
from dqreg.icp import Correspondences, InlierMixture
from dqreg.icp.noise_by_face import without_creases
from dqreg.icp.rejectors import boundary_rejectors
from dqreg.icp.stopwatch import Stopwatch
from dqreg.registration.initial_pose import GlobalSearch
from dqreg.registration.options.options import EFFORTS, Options
from dqreg.registration.pipeline import align
from dqreg.registration.problem.problem import REACH, Problem, SourceAndTarget
from dqreg.registration.problem.source import MESH_SAMPLES
from dqreg.registration.problem.target_index import index_target
from dqreg.registration.result.result import Registration
from dqreg.registration.scale_search import (
    ScaleCandidate,
    distinct_scales,
    explained,
    joint_step,
    scale_starts,
    try_scale,
    why_not_fixed,
)
from dqreg.solvers.scale import ScaleStep
from dqreg.trust.records import Reason

# Registrations at the end at most.
MAX_ALTERNATIONS = 6
# Share of its standard deviation to which the scale is followed, and the change that is none however small that is.
SCALE_TOLERANCE_SIGMAS, MIN_SCALE_CHANGE = 0.05, 1e-9
# A scale known to no more than this share is not known.
MAX_SCALE_SIGMA = 0.02


def align_with_scale(source: Any, target: Any, start: Any, options: Options) -> Registration:
    """Registration with the scale solved for."""
    watch = Stopwatch(options.time_limit)
    task = ScaleProblem.read(source, target, start, options, watch)
    found = distinct_scales(task.candidates()) or [ScaleCandidate(1.0, np.eye(4), np.inf, False)]
    doubt = why_not_fixed(task.search, found)
    watch.seconds["scale"] = watch.total
    result, step = _refined(task, found[0])
    watch.end()
    return _with_scale(result, step, doubt, task)


@dataclasses.dataclass(frozen=True)
class ScaleProblem:
    """What was asked, at a scale of 1, and the same at any other."""

    problem: Problem
    cloud: PointCloud  # The source as it was read
    name: str  # What the caller gave as the source, see `describe`
    options: Options  # As they were given
    search: GlobalSearch
    ratio: float  # Size of the target over that of the source

    @staticmethod
    def read(source: Any, target: Any, start: Any, options: Options, watch: Stopwatch) -> ScaleProblem:
        """Read both, once."""
        for name in ("dof", "prior", "viewpoint"):
            if getattr(options, name) is not None and not (name == "viewpoint" and options.without_viewpoint):
                raise InputError(
                    f'scale="solve" cannot be combined with {name}=: solve the scale first, then register with '
                    f"scale=result.scale and {name}="
                )
        index, cloud = index_target(target), as_geometry(source, "source")
        if isinstance(cloud, Mesh):
            cloud = sample_mesh(cloud, MESH_SAMPLES, np.random.default_rng(options.seed))
        at_one = dataclasses.replace(options, scale=1.0, units="ignore")
        problem = Problem.of(cloud, index, start, at_one, watch)
        scan = problem.prepare_whole().scan
        ratio = float(np.linalg.norm(index.spreads) / np.linalg.norm(principal_spreads(problem.source.cloud)))
        # In the unit of the source, so that it grows with the scale.
        max_distance = REACH * min(index.surface.diagonal / ratio, scan.diagonal)
        search = GlobalSearch(scan, index, options, max_distance, watch)
        return ScaleProblem(problem, cloud, describe(source), options, search, ratio)

    def frames(self, scale: float) -> SourceAndTarget:
        """The frames of the source at a scale, and of the target."""
        source = self.problem.source
        return SourceAndTarget(dataclasses.replace(source, origin=scale * source.origin), self.problem.target)

    def at(self, scale: float, T_centred: FloatArray) -> Problem:
        """The problem at a scale, from a pose between the centred frames."""
        limit = self.problem.watch.left
        options = dataclasses.replace(self.options, scale=scale, time_limit=limit, units="ignore", keep_inputs=True)
        start = self.frames(scale).to_caller(T_centred)
        return Problem.of(self.cloud, self.problem.target, start, options, Stopwatch(limit))

    def candidates(self) -> list[ScaleCandidate]:
        """What the scales that are tried lead to; further ones are tried where none of the first fits."""
        candidates: list[ScaleCandidate] = []
        start = self.problem.start
        for scales in scale_starts(self.ratio, searched=start is None):
            for scale in scales:
                if not self.problem.watch.is_over:
                    candidates.extend(try_scale(self.search, scale, start, self.frames))
            if explained(self.search, candidates):
                break
        return candidates


def _refined(task: ScaleProblem, found: ScaleCandidate) -> tuple[Registration, ScaleStep | None]:
    scale = found.scale
    result, step = align(task.at(scale, found.T_centred)), None
    for _ in range(MAX_ALTERNATIONS - 1):
        if not np.isfinite(result.T_target_source).all() or not found.held:
            break
        try:
            step = _last_step(task, result, scale)
        except DegenerateGeometryError:
            return result, None
        still = max(SCALE_TOLERANCE_SIGMAS * step.sigma, MIN_SCALE_CHANGE)
        if abs(math.log(step.factor)) <= still or result.status in INTERRUPTED:
            break
        scale *= step.factor
        result = align(task.at(scale, step.moved(_centred(result))))
    return result, step


def _centred(result: Registration) -> FloatArray:
    assert result.inputs is not None
    return result.inputs.to_centred(result.T_target_source)


def _last_step(task: ScaleProblem, result: Registration, scale: float) -> ScaleStep:
    scan = task.search.scan
    surface, settings = task.search.target.surface, result.settings
    share = min(max(result.inlier_fraction, 0.05), 0.999)
    mixture = InlierMixture(settings["width"], share, settings["max_distance"])

    def weigh(pairs: Correspondences) -> FloatArray:
        weights = mixture.weight(pairs.distances)
        for rejector in boundary_rejectors(surface, settings["width"]):
            weights = weights * rejector(pairs)
        # As for the last step of the pose: noise carries points over an edge onto the face behind it, to one side.
        return without_creases(pairs, weights, settings["width"])

    used = scan.taken(scan.even_rows(EFFORTS[settings["effort"]] or len(scan)))
    return joint_step(used, surface, scale, _centred(result), weigh)


def _with_scale(result: Registration, step: ScaleStep | None, doubt: Reason | None, task: ScaleProblem) -> Registration:
    """The result with all that is to be known of the scale."""
    total = result.settings["source_scale"]
    sigma = math.nan if step is None or (doubt and doubt.code == "scale_unobservable") else step.sigma
    if not doubt and not sigma <= MAX_SCALE_SIGMA:
        doubt = Reason(
            f"the scale is known to {100.0 * sigma:.2g} % only: give it, or scan more sides of the part",
            "scale_uncertain",
        )
    covariance = result.covariance
    if math.isfinite(sigma) and step is not None:
        # The pose is of the source at the scale found: where that is off, the pose is off with it.
        along = step.follow(_centred(result), np.zeros(3))
        origin = result.T_target_source[:3, :3] @ task.frames(total / task.problem.source.scale).source.origin
        along[3:] -= origin
        covariance = covariance + sigma**2 * np.outer(along, along)
    settings = {
        **result.settings,
        "source": task.name,
        "start": task.problem.asked["start"],
        "T_start": task.problem.asked["T_start"],
        "start_departure": task.problem.asked["start_departure"],
        "time_limit": task.options.time_limit,
        "units": task.options.units,
        "scale_sigma": total * sigma,
        "scale_solved": True,
    }
    return dataclasses.replace(
        result,
        verdict=result.verdict.doubted(doubt) if doubt else result.verdict,
        covariance=covariance,
        partial_information=result.partial_information if covariance is result.covariance else None,
        settings=settings,
        timings={**result.timings, **task.problem.watch.seconds},
        inputs=result.inputs if task.options.keep_inputs else None,
    )
