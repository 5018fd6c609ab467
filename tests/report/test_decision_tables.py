from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest

import dqreg
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Decision, decide, measure_deviations
from dqreg.report.decision_rows import decision_rows
from dqreg.report.decision_tables import decision_words, regions_table
from dqreg.report.inspection_table import sheet_csv
from dqreg.report.report_data import collect
from dqreg.synth.parts import box


def points() -> np.ndarray:
    """Points on the upper and the right side of a cube."""
    points = np.random.default_rng(0).uniform(-10.0, 10.0, (4000, 3))
    points[:2000, 2], points[2000:, 0] = 10.0, 10.0
    return points


def decided(points: np.ndarray) -> Decision:
    part = Mesh(*box((20.0, 20.0, 20.0)))
    return decide(measure_deviations(points, part, MeshSurface(part)), tolerance=0.1)


@pytest.fixture(scope="module")
def passed() -> Decision:
    return decided(points())


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


def test_the_share_that_is_asked_for_is_told_with_all_of_its_digits(passed: Decision) -> None:
    found = dataclasses.replace(passed, required_share=0.9995)
    assert any(words.endswith("99.95 % are required.") for words in decision_words(found, "mm", True))


def test_noise_that_would_not_pass_a_perfect_part_is_told() -> None:
    noisy = decided(points() + np.random.default_rng(1).normal(0.0, 0.08, (4000, 3)))
    assert noisy.share == "undecided"
    (said,) = set(decision_words(noisy, "mm", True, 0.08)) - set(decision_words(noisy, "mm", True))
    # Within 0.1 of 0.08: 1.25 standard deviations.
    assert said.startswith("Noise of 0.08 mm alone leaves 78.9 % of the points of a perfect part within")
    assert said.endswith("proves no fault either.")
    assert decision_words(noisy, "mm", True, 0.04) == decision_words(noisy, "mm", True)
    chips = dataclasses.replace(noisy, share="fail")
    assert any(words.endswith("more are out than that explains.") for words in decision_words(chips, "mm", True, 0.08))


def test_what_was_not_scanned_is_not_decided(passed: Decision) -> None:
    for scanned, said in ((0.112, "11.2 % of the part's surface was scanned; of the rest nothing is decided."),
                          (1.0, "100 % of the part's surface was scanned.")):  # fmt: skip
        assert said in decision_words(dataclasses.replace(passed, scanned=scanned), "mm", True)
    without = decision_words(dataclasses.replace(passed, scanned=np.nan), "mm", True)
    assert not any("scanned" in words for words in without)


def test_a_region_that_fails_within_its_limits_says_why() -> None:
    bump, lines = points(), points()
    bump[:2000, 2] += 0.5 * (np.linalg.norm(bump[:2000, :2], axis=1) < 3.0)
    # One point in ten out, none beside another: no place fails, the share does.
    lines[:2000:10, 2] += 0.5
    for moved, said, cause in (
        (bump, "a place of it deviates by 0.5 ± ", ("place", pytest.approx(0.5, abs=0.02), -0.1, 0.1)),
        (lines, "90.0 % of its points are within", ("share", pytest.approx(90.0, abs=0.1), 95.0)),
    ):
        share, *regions = decision_rows(decided(moved))
        assert (share.kind, share.value) == ("share", pytest.approx(100.0 * decided(moved).share_within))
        (bad,) = [row for row in regions if row.outcome == "fail"]
        assert bad.low < bad.value < bad.high
        assert bad.remark.startswith(said)
        assert bad.cause is not None
        assert dataclasses.astuple(bad.cause)[: len(cause)] == cause
        assert [(row.remark, row.cause) for row in regions if row.outcome == "pass"] == [("", None)]
        # A reader of the table has them in columns of their own.
        rows = list(csv.DictReader(sheet_csv(None, decided(moved), "mm").splitlines()))
        (line,) = [row for row in rows if "median" in row["characteristic"] and row["decision"] == "fail"]
        assert (line["decided by"], float(line["deciding value"]), float(line["deciding low"])) == cause[:3]


def test_regions_have_the_decimals_that_their_scatter_leaves_and_no_powers_of_ten() -> None:
    part = Mesh(*box((20.0, 20.0, 20.0)))
    result = dqreg.register(points(), Mesh(part.vertices - part.centre, part.faces), start=np.eye(4), units="ignore")
    assert result.inputs is not None
    data = collect(result, result.inputs, tolerance=0.1)
    # Of 2000 points that scatter by 0.02 the median is known to 1.25 * 0.02 / sqrt(2000) = 0.00056.
    for median, shown in ((3.9e-5, "+0.00004"), (-0.1, "−0.10000"), (1e-7, "0.00000")):
        regions = tuple(dataclasses.replace(r, median=median, spread=0.02, within=0.0401) for r in data.regions)
        row = regions_table(dataclasses.replace(data, regions=regions))["rows"][0]
        assert (row["median"], row["spread"], row["p95"]) == (shown, "0.020", "0.040")
