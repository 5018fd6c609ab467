"""The report of what was once accepted though wrong: its runs are kept, and none of them is accepted any more."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dqreg.compare.trust.trial import Trial
from tests.trust.reproductions import Row, read, rows, run, table


def made(name: str, seed: int, *, right: bool, level: str = "accepted") -> Trial:
    return Trial(name, seed, False, level, right, 0.5, (level,), "", 10, 0.1, confidence=0.9)


def test_a_report_goes_on_where_it_was_stopped_and_counts_what_matters(tmp_path: Path) -> None:
    asked: list[tuple[str, int]] = []

    def runs(name: str, *, right: bool) -> Row:
        def one(seed: int) -> Trial:
            asked.append((name, seed))
            return made(name, seed, right=right)

        return Row(name, name, (3, 4), 2, one, good=right)

    wrong, good = runs("wrong", right=False), runs("good", right=True)
    run([wrong], tmp_path / "runs.jsonl", 5)
    found = run([wrong, good], tmp_path / "runs.jsonl", 5)
    # In turns, and nothing twice.
    assert asked == [("wrong", 5), ("wrong", 6), ("good", 5), ("good", 6)]
    assert read(tmp_path / "runs.jsonl") == found
    lines = table([wrong, good], found).splitlines()[2:]
    assert lines[0].startswith("| wrong | 3 of 4 | 2 | 0 | 2 |")
    assert lines[1].startswith("| good (to be accepted) | 3 of 4 | 2 | 2 | 2 |")


DATA = Path(os.environ.get("DQREG_DATA") or Path(__file__).parents[2].parent / "shared" / "data")


@pytest.mark.soak
@pytest.mark.parametrize("row", rows(DATA if DATA.is_dir() else None), ids=lambda row: row.name)
def test_nothing_that_was_reported_is_accepted_again(row: Row) -> None:
    # Truths: of the tasks, which are made; of measured scans, the data sets' own poses. Nothing was tuned on the seeds.
    found = [row.run(seed) for seed in range(7600, 7603)]
    assert not any(one.wrong_accept for one in found)
    assert not row.good or all(one.right for one in found)
