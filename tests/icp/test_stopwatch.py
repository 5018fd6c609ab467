from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dqreg.geometry import CloudSurface, PointCloud, prepare_scan
from dqreg.icp import Icp, Stopping, stopwatch
from dqreg.icp.history import Iteration
from dqreg.icp.loop import TIME_IS_UP
from dqreg.icp.stopwatch import Stopwatch

RECORD = Iteration(1, "fine", 10, 10, 1.0, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0, np.eye(4))


def test_the_stages_are_timed_in_their_order_within_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    # When the watch is made, at both ends of two stages, and when it is asked.
    readings = iter([10.0, 11.0, 14.0, 15.0, 17.0, 20.0])
    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=lambda: next(readings)))
    watch = Stopwatch()
    with watch.stage("read"):
        pass
    with watch.stage("register"):
        pass
    assert list(watch.seconds.items()) == [("read", 3.0), ("register", 2.0)]
    assert watch.total == 10.0


def test_without_a_limit_nothing_ends_and_the_observer_is_itself() -> None:
    watch = Stopwatch()
    assert watch.left is None
    assert not watch.is_over
    assert watch.watching(None) is None
    assert watch.watching(print) is print


def test_an_observer_hears_every_record_and_the_limit_ends_the_loop() -> None:
    seen: list[Iteration] = []
    early, late = Stopwatch(1e3), Stopwatch(1e-9)
    for watch, answer in ((early, None), (late, TIME_IS_UP)):
        watching = watch.watching(seen.append)
        assert watching is not None
        assert watching(RECORD) is answer
    assert seen == [RECORD, RECORD]
    assert late.is_over
    assert late.left == pytest.approx(1e-9)


def test_the_loop_says_who_ended_it() -> None:
    points = np.random.default_rng(0).normal(size=(200, 3))
    scan, surface = prepare_scan(PointCloud(points)), CloudSurface(PointCloud(points + 0.01))
    stopping = Stopping(convergence=-1.0)
    for limit, observe, status in (
        (1e-9, None, "time limit"),
        (1e3, lambda record: False, "stopped by observer"),
        # Both at once: more time would change it.
        (1e-9, lambda record: False, "time limit"),
    ):
        run = Icp(stopping=stopping).run(scan, surface, np.eye(4), Stopwatch(limit).watching(observe))
        assert (run.status, len(run.history)) == (status, 1)
