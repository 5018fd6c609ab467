from __future__ import annotations

import logging
import subprocess
import sys

import numpy as np
import pytest

import dqreg
from dqreg.registration.result.log import LOGGER, log_verdict
from dqreg.trust.records import Verdict
from tests.registration.test_register import PART, SCAN, START


def test_a_line_a_result_and_a_warning_where_it_is_not_accepted(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "dqreg"):
        good = dqreg.register(SCAN, PART, START, effort="fast")
        bad = dqreg.register(np.add(SCAN[:40], [1e3, 0.0, 0.0]), PART, "identity", effort="fast", search="never")
    assert (good.verdict.level, bad.verdict.level) == ("accepted", "failed")
    assert [record.levelname for record in caplog.records] == ["INFO", "WARNING"]
    assert all(record.name == "dqreg" and "\n" not in record.message for record in caplog.records)
    assert good.verdict.reasons[0] in caplog.records[0].message
    assert all(reason in caplog.records[1].message for reason in bad.verdict.reasons)


def test_nobody_who_does_not_listen_hears_of_it() -> None:
    code = (
        "import dqreg\n"
        "from dqreg.registration.result.log import log_verdict\n"
        "from dqreg.trust.records import Verdict\n"
        "log_verdict(Verdict('failed', ('no reason',)), 'scan to part', 1.0)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (found.stdout, found.stderr) == ("", "")


def test_no_line_is_made_for_nobody(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "dqreg")
    said: list[str] = []
    monkeypatch.setattr(LOGGER, "handle", lambda record: said.append(record.getMessage()))
    verdict = Verdict("accepted", ("well",))
    monkeypatch.setattr(LOGGER, "propagate", False)
    log_verdict(verdict, "scan to part", 1.0)
    assert not said
    monkeypatch.setattr(LOGGER, "handlers", [*LOGGER.handlers, logging.Handler()])
    log_verdict(verdict, "scan to part", 1.0)
    assert said == ["scan to part: accepted in 1.000 s: well"]


def test_results_are_one_line() -> None:
    result = dqreg.register(SCAN, PART, START, effort="fast")
    cost = dqreg.PoseCost.points(SCAN[:5], SCAN[:5])
    shown = [
        result,
        result.verdict,
        dqreg.prepare_target(PART),
        result.deviations(tolerance=0.1),
        dqreg.solve(SCAN[:5], SCAN[:5]),
        dqreg.solve_many(SCAN[None, :5], SCAN[None, :5]),
        cost,
        dqreg.PointCloud(SCAN),
        PART,
        dqreg.Trajectory([0.0, 1.0], [START, START]),
        dqreg.rigid.pose.mean([START, START]),
        dqreg.Freedom.only("rz"),
    ]
    for each in shown:
        assert repr(each).startswith(type(each).__name__)
        assert "\n" not in repr(each)
        assert len(repr(each)) < 500
    assert repr(result).startswith("Registration(accepted, translation=(")
