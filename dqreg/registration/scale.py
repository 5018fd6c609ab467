"""``scale="solve"``: one number from source to target, found and refined together with the pose, because it was asked.

The scale is found on a few thousand points (`scale_search`). Then the source is registered at that scale like any
other, a joint step on the final matches corrects scale and pose, and both alternate until the scale is stationary.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, sample_mesh
from dqreg.geometry.opening import describe, read_any
from dqreg.geometry.scan import Scan, prepare_scan
from dqreg.geometry.unit_check import principal_spreads
from dqreg.icp import InlierMixture, Pairs
from dqreg.icp.rejectors import inland
from dqreg.icp.stopwatch import Deadline
from dqreg.registration.assess import from_work
from dqreg.registration.initial_pose import Searching, read_start
from dqreg.registration.options import EFFORTS, Options
from dqreg.registration.result import Registration
from dqreg.registration.scale_search import (
    ScaleCandidate,
    distinct_scales,
    explained,
    joint_step,
    scale_starts,
    try_scale,
    why_not_fixed,
)
from dqreg.registration.source import MESH_SAMPLES, centre_source
from dqreg.registration.target_index import index_target
from dqreg.solvers.scale import ScaleStep
from dqreg.solvers.status import INTERRUPTED
from dqreg.trust.records import Reason, Verdict

# Registrations at the end at most; and the share of its standard deviation to which the scale is followed.
TURNS, FOLLOWED, STILL = 6, 0.05, 1e-9
# Smaller of both sizes that a pair may be apart, see `dqreg.register`.
REACH = 0.2
# A scale known to no more than this share is not known.
VAGUE = 0.02


def require_free_scale(arguments: dict[str, Any]) -> None:
    """Raise where the scale cannot be solved for beside what else was asked."""
    for name in ("dof", "prior", "viewpoint"):
        if arguments.get(name) is not None:
            raise InputError(
                f'scale="solve" cannot be combined with {name}=: solve the scale first, then register with '
                f"scale=result.scale and {name}="
            )


def register_scaled(register: Callable[..., Registration], arguments: dict[str, Any]) -> Registration:
    """Registration with the scale solved for."""
    began = time.perf_counter()
    require_free_scale(arguments)
    task = _Task.of(arguments, began)
    found = distinct_scales(task.candidates()) or [ScaleCandidate(1.0, np.eye(4), np.inf, False)]
    doubt = why_not_fixed(task.searching, found)
    finding = time.perf_counter() - began
    result, step = _refined(register, task, found[0])
    return _told(result, step, doubt, task, {"scale": finding, "total": time.perf_counter() - began})


@dataclasses.dataclass(frozen=True)
class _Task:
    """Both sides, read once, and what was asked for."""

    arguments: dict[str, Any]
    searching: Searching
    origin: FloatArray
    units: float
    T_start: FloatArray | None
    ratio: float

    @staticmethod
    def of(arguments: dict[str, Any], began: float) -> _Task:
        indexed = index_target(arguments["target"])
        options = Options(**{field.name: arguments[field.name] for field in dataclasses.fields(Options)})
        source = read_any(arguments["source"], "source")
        if isinstance(source, Mesh):
            source = sample_mesh(source, MESH_SAMPLES, np.random.default_rng(options.seed))
        units = arguments["source_units"], arguments["target_units"] or indexed.units
        centred = centre_source(source, *units, np.random.default_rng(options.seed))
        scan = prepare_scan(centred.cloud, options.fitted)
        ratio = float(np.linalg.norm(indexed.spreads) / np.linalg.norm(principal_spreads(centred.cloud)))
        # In the unit of the source, so that it grows with the scale.
        reach = REACH * min(indexed.surface.diagonal / ratio, scan.diagonal)
        searching = Searching(
            scan, indexed, options, reach, Deadline(began, options.time_limit), arguments["observe_search"]
        )
        given = {**arguments, "source": source, "target": indexed, "described": describe(arguments["source"])}
        T_start = read_start(arguments["start"], None, None)
        return _Task(given, searching, centred.origin, centred.scale, T_start, ratio)

    def candidates(self) -> list[ScaleCandidate]:
        """What the scales that are tried lead to; further ones are tried where none of the first fits."""
        candidates: list[ScaleCandidate] = []
        for scales in scale_starts(self.ratio, searched=self.T_start is None):
            for scale in scales:
                if not self.searching.deadline.is_over:
                    candidates.extend(try_scale(self.searching, scale, self.T_start, self.origin))
            if explained(self.searching, candidates):
                break
        return candidates

    def again(self, register: Callable[..., Registration], scale: float, T: FloatArray) -> Registration:
        """Register at a scale, from a pose between the centred frames."""
        start = from_work(T, self.searching.target.origin, scale * self.origin)
        asked = {name: value for name, value in self.arguments.items() if name != "described"}
        limit = self.searching.deadline.left
        return register(
            **{**asked, "scale": scale, "start": start, "time_limit": limit, "units": "ignore", "keep_inputs": True}
        )


def _refined(
    register: Callable[..., Registration], task: _Task, found: ScaleCandidate
) -> tuple[Registration, ScaleStep | None]:
    scale, T = found.scale, found.T_work
    result, step = task.again(register, scale, T), None
    for _ in range(TURNS - 1):
        if not np.isfinite(result.T_target_source).all() or not found.held:
            break
        try:
            step = _last_step(task, result, scale)
        except DegenerateGeometryError:
            return result, None
        still = max(FOLLOWED * step.sigma, STILL)
        if abs(math.log(step.factor)) <= still or result.status in INTERRUPTED:
            break
        scale *= step.factor
        result = task.again(register, scale, step.moved(_work(task, result)))
    return result, step


def _work(task: _Task, result: Registration) -> FloatArray:
    assert result.inputs is not None
    R, t = result.T_target_source[:3, :3], result.T_target_source[:3, 3]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, R @ result.inputs.source.origin + t - task.searching.target.origin
    return T


def _last_step(task: _Task, result: Registration, scale: float) -> ScaleStep:
    scan: Scan = task.searching.scan
    surface, settings = task.searching.target.surface, result.settings
    share = min(max(result.inlier_fraction, 0.05), 0.999)
    mixture = InlierMixture(settings["width"], share, settings["max_distance"])

    def weigh(pairs: Pairs) -> FloatArray:
        weights = mixture.weight(pairs.distances)
        for gate in inland(surface, settings["width"]):
            weights = weights * gate(pairs)
        return weights

    used = scan.taken(scan.even_rows(EFFORTS[settings["effort"]] or len(scan)))
    return joint_step(used, surface, scale, _work(task, result), weigh)


def _told(
    result: Registration, step: ScaleStep | None, doubt: Reason | None, task: _Task, timings: dict[str, float]
) -> Registration:
    """The result with all that is to be known of the scale."""
    total = result.settings["source_scale"]
    sigma = math.nan if step is None or (doubt and doubt.code == "scale_unobservable") else step.sigma
    if not doubt and not sigma <= VAGUE:
        doubt = Reason(
            f"the scale is known to {100.0 * sigma:.2g} % only: give it, or scan more sides of the part",
            "scale_uncertain",
        )
    covariance = result.covariance
    if math.isfinite(sigma) and step is not None:
        # The pose is of the source at the scale found: where that is off, the pose is off with it.
        along = step.follow(_work(task, result), np.zeros(3))
        origin = result.T_target_source[:3, :3] @ (total / task.units * task.origin)
        along[3:] -= origin
        covariance = covariance + sigma**2 * np.outer(along, along)
    verdict = result.verdict
    if doubt and verdict.level != "failed":
        kept = verdict.reasons if verdict.level == "suspect" else ()
        verdict = Verdict("suspect", (doubt, *kept))
    start = task.arguments["start"]
    asked = {
        "source": task.arguments["described"],
        "start": "search" if start is None else start if isinstance(start, str) else "given",
        "T_start": None if task.T_start is None else task.T_start.tolist(),
        "time_limit": task.arguments["time_limit"],
        "units": task.arguments["units"],
        "scale_sigma": total * sigma,
        "scale_solved": True,
    }
    return dataclasses.replace(
        result,
        verdict=verdict,
        covariance=covariance,
        settings={**result.settings, **asked},
        timings={**result.timings, **timings},
        inputs=result.inputs if task.arguments["keep_inputs"] else None,
    )
