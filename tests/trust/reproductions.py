"""What the verdict once accepted though it was wrong, tried again at the counts of that report.

Each row is a kind of task with how many of how many were accepted when it was reported. The runs go in turns over the
rows and are kept one a line, so that a run which is stopped has figures of every row, and the same command goes on:

    python -m tests.trust.reproductions runs.jsonl [--data FOLDER] [--first-seed 7300] [--only NAME,NAME]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from dqreg.compare.proportions import interval
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.rates import percent
from dqreg.compare.trust.task import Kind, TrustTask
from dqreg.compare.trust.trial import Trial, trial
from tests.trust.reported_tasks import (
    beside_the_answer,
    block_on_half,
    figure_from_behind,
    flipped_ring,
    moved_boss,
    moved_gear,
    noise_cloud,
    real_start,
    within_a_limit,
)

FIRST_SEED = 7300


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the report."""

    name: str
    words: str
    before: tuple[int, int]  # Reported: so many of so many; none counted where the second is zero
    count: int  # Runs now
    run: Callable[[int], Trial]
    good: bool = False  # Whether acceptance is what is wanted; else what is counted is a hole


def of_kinds(*names: str) -> Callable[[int], Trial]:
    """Kinds of the trust sweep in turns."""
    return lambda seed: trial(KINDS[names[seed % len(names)]], seed)


def of_task(name: str, make: Callable[[np.random.Generator], TrustTask]) -> Callable[[int], Trial]:
    """A task of this report."""
    return lambda seed: trial(Kind(name, "reported", False, "", make), seed)


def rows(data: Path | None) -> list[Row]:
    """All lines; those of measured data only where they are."""
    found = [
        Row("noise on parts", "noise clouds of 60 to 400 points on two parts", (49, 144), 144,
            of_task("noise on parts", noise_cloud)),
        Row("blob pairs", "two different blobs as clouds", (20, 30), 30, of_kinds("two-blobs")),
        Row("noise pairs", "noise on noise, as clouds", (0, 0), 30, of_kinds("two-noises")),
        Row("half beside", "a block of 160 on a block of 80", (1, 1), 12, of_task("half beside", block_on_half)),
        Row("longer block", "a third to a half of a scan beside the part", (1, 1), 20, of_kinds("longer-block")),
        Row("stairs", "stairs, one period off", (12, 20), 20, of_kinds("stairs-off")),
        Row("pegs", "plate of pegs, one period off", (7, 21), 21, of_kinds("pegs-off")),
        Row("lattice", "in the middle of a lattice", (15, 15), 15, of_kinds("pegs-middle")),
        Row("longer", "longer by 5 to 20 %", (3, 19), 19, of_kinds("longer-5-20")),
        Row("stretched", "stretched by 3 to 5 %", (10, 23), 23, of_kinds("stretched-3-5")),
        Row("scaled by 1 %", "scaled by 1 to 1.5 %", (14, 60), 60, of_kinds("scaled-1")),
        Row("scaled by 3 %", "scaled by 3 to 5 %", (5, 60), 60, of_kinds("scaled-3")),
        Row("mirrored", "mirrored", (2, 22), 22, of_kinds("mirrored")),
        Row("50 points", "50 points of another part", (1, 15), 15, of_kinds("another-50-points")),
        Row("wrong cloud poses", "views far from their start, of opposite sides, of both sides of a plate", (24, 175),
            175, of_kinds("clouds-far-start", "clouds-plate-sides", "clouds-opposite", "clouds-opposite-lump")),
        Row("right cloud poses", "views 10 to 50 degrees apart, 5 degrees off", (88, 106), 106,
            of_kinds("clouds-10-30", "clouds-30-50"), good=True),
        Row("max_distance", "bad starts with max_distance", (7, 16), 16, of_kinds("max-distance")),
        Row("truth beside", "another answer than a right alternative, random starts", (7, 8), 24,
            beside_the_answer(started=True)),
        Row("truth beside, none", "the same from nothing, on a table", (4, 4), 12, beside_the_answer(started=False)),
        Row("time limits", "a limit returns a pose worse than its start", (1, 1), 24, within_a_limit),
        Row("strays", "from nothing with 30 % strays", (0, 0), 40, of_kinds("nothing-strays-30"), good=True),
        Row("moved gear", "a gear that moved during its sweep, 1.7 % off", (1, 1), 8, moved_gear),
        Row("flipped ring", "a ring upside down about an axis that is not principal", (1, 1), 16,
            of_task("flipped ring", flipped_ring)),
        Row("moved boss", "a feature moved by 3 % pulls the pose along", (0, 0), 16, of_task("moved boss", moved_boss)),
    ]  # fmt: skip
    if data is not None:
        found += [
            Row("figure", "views of a figure from opposite sides", (4, 108), 108,
                of_task("figure", figure_from_behind(data))),
            Row("real 180", "real parts, start half a turn off", (4, 187), 187,
                of_task("real 180", real_start(data, 180.0, 0.02))),
            Row("real 5", "real parts, start 5 degrees and 2 % off", (6, 1120), 1120,
                of_task("real 5", real_start(data, 5.0, 0.02))),
        ]  # fmt: skip
    return found


def counted(row: Row, runs: Iterable[Trial]) -> int:
    """Right ones accepted of a good row; what must not be accepted of another."""
    return sum(one.level == "accepted" and one.right if row.good else one.wrong_accept for one in runs)


def table(chosen: list[Row], runs: dict[tuple[str, int], Trial]) -> str:
    """All rows as a Markdown table."""
    lines = [
        "| what | accepted then | runs now | right poses | accepted now | 95 % interval |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for row in chosen:
        here = [one for (name, _), one in runs.items() if name == row.name]
        if not here:
            continue
        count, then = counted(row, here), f"{row.before[0]} of {row.before[1]}" if row.before[1] else "not counted"
        low, high = interval(count, len(here))
        right = sum(one.right for one in here)
        words = row.words + (" (to be accepted)" if row.good else "")
        lines.append(f"| {words} | {then} | {len(here)} | {right} | {count} | {percent(low)} - {percent(high)} |")
    return "\n".join(lines)


def read(path: Path) -> dict[tuple[str, int], Trial]:
    """The runs so far."""
    found = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        kept = json.loads(line)
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in kept["trial"].items()}
        found[kept["row"], kept["seed"]] = Trial(**values)
    return found


def run(chosen: list[Row], path: Path, first_seed: int = FIRST_SEED) -> dict[tuple[str, int], Trial]:
    """Carry out what is not in the file yet, in turns over the rows."""
    runs = read(path)
    with path.open("a") as file:
        for turn in range(max(row.count for row in chosen)):
            for row in chosen:
                key = row.name, first_seed + turn
                if turn >= row.count or key in runs:
                    continue
                one = runs[key] = row.run(key[1])
                file.write(json.dumps({"row": key[0], "seed": key[1], "trial": dataclasses.asdict(one)}) + "\n")
                file.flush()
                if one.wrong_accept or (row.good and one.level != "accepted"):
                    sys.stdout.write(f"{key[0]} {key[1]}: {one.kind}, {one.level}, off {one.error:.3g}: {one.reason}\n")
                    sys.stdout.flush()
    return runs


def main() -> None:
    """Run all rows and show the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    names = set(filter(None, options.only.split(",")))
    chosen = [row for row in rows(options.data) if not names or row.name in names]
    sys.stdout.write(table(chosen, run(chosen, options.runs, options.first_seed)) + "\n")


if __name__ == "__main__":
    main()
