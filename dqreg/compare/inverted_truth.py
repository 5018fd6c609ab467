"""Whether the true pose of a case is given the wrong way round."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from dqreg.compare.judge import judge
from dqreg.compare.plan import PlannedRun
from dqreg.compare.records import RunRecord
from dqreg.rigid import pose


def inverted_truths(items: Iterable[PlannedRun], runs: Sequence[RunRecord]) -> tuple[str, ...]:
    """A sentence for each case where no engine is right, and two or more would be if the true pose were inverted."""
    names = [
        item.case for item in items if item.case and _would_fit(item, [run for run in runs if run.key == item.key])
    ]
    return tuple(
        f"{name}: no pose that was found is the true one, but the inverse of the true one is: is the truth given from "
        "target to source? It must be T_target_source."
        for name in dict.fromkeys(names)
    )


def _would_fit(item: PlannedRun, runs: list[RunRecord]) -> bool:
    if any(run.success is not False for run in runs):
        return False
    truth = item.make().ground_truth
    found = {run.engine: np.array(run.T_target_source) for run in runs if run.kind == "rigid"}
    return sum(judge(pose.inverse(T), truth).success is True for T in found.values()) >= 2
