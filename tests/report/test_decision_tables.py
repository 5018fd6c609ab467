from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Decision, decide, measure_deviations
from dqreg.report.decision_tables import decision_words
from dqreg.synth.parts import box


@pytest.fixture(scope="module")
def passed() -> Decision:
    part = Mesh(*box((20.0, 20.0, 20.0)))
    points = np.random.default_rng(0).uniform(-10.0, 10.0, (4000, 3))
    points[:2000, 2], points[2000:, 0] = 10.0, 10.0
    return decide(measure_deviations(points, part, MeshSurface(part)), tolerance=0.1)


@pytest.mark.parametrize(
    ("outcomes", "said"),
    [
        (("pass", "undecided"), "1 region is undecided"),
        (("undecided", "undecided"), "2 of 2 regions are undecided"),
        (("fail", "pass"), "1 region fails"),
        (("fail", "fail"), "2 of 2 regions fail"),
    ],
)
def test_the_regions_that_decide_are_told(passed: Decision, outcomes: tuple[str, str], said: str) -> None:
    assert len(passed.regions) == 2
    without = decision_words(passed, "mm", True)
    regions = tuple(dataclasses.replace(r, outcome=o) for r, o in zip(passed.regions, outcomes, strict=True))
    words = decision_words(dataclasses.replace(passed, regions=regions), "mm", True)
    (new,) = set(words) - set(without)
    assert new.startswith(said)
