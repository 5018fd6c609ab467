"""The runs of pairs: what they keep, and for how long."""

from __future__ import annotations

import numpy as np

from dqreg.multiway.pairwise.pair_runs import PairJob, PairRunner, Progress
from dqreg.multiway.scans.scans import read_views
from dqreg.registration.initial_pose import PAIRS
from tests.multiway.test_register_many import views_of_a_part


def test_tables_of_a_scan_are_dropped_after_its_last_pair() -> None:
    views = read_views([points[::5] for points in views_of_a_part(3)[0]], 0)
    indices = [view.target.indexed for view in views if view.target is not None]

    def held() -> list[int]:
        return [
            k for k, index in enumerate(indices) if "pairs" in vars(index) or index.derived.known(PAIRS) is not None
        ]

    seen: list[list[int]] = []

    def observe(_: Progress) -> None:
        seen.append(held())

    runner = PairRunner(views, None, "fast", 0, 1, np.inf, observe, None)
    runner.run([PairJob(0, 1), PairJob(0, 2), PairJob(1, 2)])
    assert seen == [[0], [0], [1]]
    assert held() == []
