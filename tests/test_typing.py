"""What a type checker catches: mypy reads this file, and an error that it no longer finds is an unused ignore."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, get_type_hints

import dqreg
from dqreg.odometry.settings import OdometryOptions, OdometrySettings
from dqreg.registration.options.options import Options, RegisterOptions
from dqreg.trust import Evidence

if TYPE_CHECKING:
    points = [[0.0, 0.0, 0.0]]
    target = dqreg.prepare_target(points)
    dqreg.register(points, points, efort="fast")  # type: ignore[call-arg]
    dqreg.register(points, points, effort="quick")  # type: ignore[arg-type]
    dqreg.register(points, points, search="sometimes")  # type: ignore[arg-type]
    target.register(points, efort="fast")  # type: ignore[call-arg]
    target.register(points, effort="quick")  # type: ignore[arg-type]
    target.register(points, effort="fast", max_distance=2.0, time_limit=1.0)
    dqreg.Odometry(voxelsize=1.0)  # type: ignore[call-arg]
    dqreg.Odometry(method="magic")  # type: ignore[arg-type]
    dqreg.Odometry(voxel_size=1.0, deskew=False)
    dqreg.register_many([points], effort="quick")  # type: ignore[arg-type]
    dqreg.register_many([points], order="random")  # type: ignore[arg-type]
    dqreg.register_many([points], edges="all")  # type: ignore[arg-type]
    dqreg.register_many([points], edges=[(0, 1)], order="sequence")
    dqreg.register(points, points, clutter="nothing")  # type: ignore[arg-type]
    dqreg.register(points, points, units="ignored")  # type: ignore[arg-type]
    result = target.register(points)
    _ = result.verdict.codes[0] == "drfit"  # type: ignore[comparison-overlap]
    _ = result.verdict.checks[0].code == "drfit"  # type: ignore[comparison-overlap]
    options = Options("auto", None, 60.0, "normal", 0, accelerate=True, max_iterations=100, convergence=1e-7)
    _ = options.search == "alwyas"  # type: ignore[comparison-overlap]
    _ = options.effort == "bset"  # type: ignore[comparison-overlap]
    _ = Evidence.clutter == "nnoe"  # type: ignore[comparison-overlap]
    _ = result.verdict.level == "acepted"  # type: ignore[comparison-overlap]
    result.covariance_in("world")  # type: ignore[arg-type]
    result.covariance_in("source", order="tr", side="left").sum()
    dqreg.registr(points)  # type: ignore[attr-defined]


def test_the_options_that_are_handed_on_are_those_of_register() -> None:
    own = set(inspect.signature(dqreg.register).parameters) - {"source", "target", "start", "time_limit"}
    assert RegisterOptions.__annotations__.keys() == own
    kinds, handed_on = (get_type_hints(each) for each in (dqreg.register, RegisterOptions))
    assert {name: handed_on[name] for name in own} == {name: kinds[name] for name in own}


def test_the_options_of_the_odometry_are_its_settings() -> None:
    assert get_type_hints(OdometryOptions) == get_type_hints(OdometrySettings)
