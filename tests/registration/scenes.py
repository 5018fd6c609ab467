"""Problems for the stages of a registration."""

from __future__ import annotations

from typing import Any

from dqreg.icp.stopwatch import Stopwatch
from dqreg.registration.fit.fit import Fit, coarse_to_fine
from dqreg.registration.options.options import CONVERGENCE, Options
from dqreg.registration.problem.problem import Problem


def problem_of(source: Any, target: Any, start: Any = None, time_limit: float | None = None, **options: Any) -> Problem:
    """A problem with the defaults of `dqreg.register`."""
    defaults = {
        "method": "auto",
        "max_distance": None,
        "max_angle_deg": 60.0,
        "effort": "normal",
        "seed": 0,
        "accelerate": True,
        "max_iterations": 100,
        "convergence": CONVERGENCE,
        "time_limit": time_limit,
    }
    return Problem.of(source, target, start, Options(**{**defaults, **options}), Stopwatch(time_limit))


def fit_of(problem: Problem) -> Fit:
    """Where the loop ends from the initial pose, before any other pose is asked for."""
    assert problem.start is not None
    prepared, T = problem.prepare(), problem.to_centred(problem.start)
    constraints = problem.constraints(T)
    settings = problem.options.icp_settings(problem.max_distance(prepared), constraints)
    return coarse_to_fine(problem, prepared, T, settings, constraints)
