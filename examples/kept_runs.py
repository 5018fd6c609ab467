"""Runs of `from_nothing.py`, kept one a line in a file, so that a race that was stopped goes on; and their tables."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from rich.table import Table

HEADINGS = ("scans", "part", "method", "right", "accepted though wrong", "median CPU s", "median wall s")
# What stands in the place of a verdict for those who give none.
NO_VERDICT = "none given"


@dataclasses.dataclass(frozen=True)
class Run:
    """One method on one scan; the pose row by row, ``error`` in sizes, ``note`` what else there is to say."""

    part: str
    cell: str
    seed: int
    method: str
    right: bool
    verdict: str
    error: float | None
    cpu_seconds: float
    wall_seconds: float
    search_seconds: float | None = None
    prepare_seconds: float | None = None
    note: str = ""
    T_target_source: tuple[float, ...] = ()

    @property
    def accepted(self) -> bool:
        return self.verdict == "accepted"

    @property
    def line(self) -> str:
        """For the screen."""
        right = "right" if self.right else "wrong"
        return (
            f"{self.cell} {self.part}, seed {self.seed}, {self.method}: {right}, verdict {self.verdict}, "
            f"{self.cpu_seconds:.2f} s CPU, {self.wall_seconds:.2f} s"
        )


class Keeper:
    """Runs by part, cell, seed and method; those of the file first, new ones are appended to it at once."""

    def __init__(self, path: Path | None) -> None:
        self.path, self.runs = path, {}
        if path is not None and path.exists():
            self.runs = {_key(run): run for run in _read(path)}

    def has(self, part: str, cell: str, seed: int, method: str) -> bool:
        return (part, cell, seed, method) in self.runs

    def add(self, run: Run) -> None:
        self.runs[_key(run)] = run
        if self.path is not None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            # What was killed in the middle of a line left no end of it.
            torn = self.path.exists() and not self.path.read_bytes().endswith(b"\n") and self.path.stat().st_size > 0
            with self.path.open("a", encoding="utf-8") as file:
                line = json.dumps({**dataclasses.asdict(run), "accepted": run.accepted})
                file.write("\n" * torn + line + "\n")


def _key(run: Run) -> tuple[str, str, int, str]:
    return run.part, run.cell, run.seed, run.method


def _read(path: Path) -> Iterator[Run]:
    for line in path.read_text(encoding="utf-8").splitlines():
        # The last line of a run that was killed may be half a line.
        if line.startswith("{") and line.endswith("}"):
            values = json.loads(line)
            values.pop("accepted")
            yield Run(**values)


def rows_of(runs: Iterable[Run], apart: list[str]) -> list[tuple[str, ...]]:
    """One row for each kind of scan and method, and one more for each part that is to stand apart."""
    groups: dict[tuple[str, str, str], list[Run]] = {}
    for run in runs:
        for part in ("all", *(name for name in apart if name in run.part)):
            groups.setdefault((run.cell, part, run.method), []).append(run)
    return [(*key, *_figures(group)) for key, group in sorted(groups.items(), key=lambda item: item[0][:2])]


def _figures(runs: list[Run]) -> tuple[str, ...]:
    right = sum(run.right for run in runs)
    judged = any(run.verdict != NO_VERDICT for run in runs)
    wrong = str(sum(run.accepted and not run.right for run in runs)) if judged else "no verdict"
    seconds = (f"{np.median([getattr(run, name) for run in runs]):.2f}" for name in ("cpu_seconds", "wall_seconds"))
    return f"{right} of {len(runs)} ({100 * right / len(runs):.1f} %)", wrong, *seconds


def on_screen(rows: list[tuple[str, ...]], title: str) -> Table:
    table = Table(*HEADINGS, title=title, box=None)
    for row in rows:
        table.add_row(*row)
    return table


def as_markdown(rows: list[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (HEADINGS, ("---",) * len(HEADINGS), *rows))
