"""`dqreg evaluate RESULT --truth FILE`: the errors of a pose against the truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from dqreg.compare import Score, Yardstick

FILE = click.Path(path_type=Path)


@click.command()
@click.argument("result", type=FILE)
@click.option("--truth", type=FILE, required=True, help="truth.json of a case, a result.json, or a 4x4 text.")
@click.option("--target", type=FILE, help="Part or cloud whose points are measured  [default: part.stl beside the "
              "truth].")  # fmt: skip
@click.option("--scan", type=FILE, help="Scan, to measure its distance from the target too.")
@click.option("--within", type=float, help="Exit with 1 if a point of the target is farther off than this length.")
@click.option("--out", type=FILE, help="Write the figures as JSON.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def evaluate(
    result: Path,
    truth: Path,
    target: Path | None,
    scan: Path | None,
    within: float | None,
    out: Path | None,
    quiet: bool,
) -> int:
    """Judge a pose: RESULT is a result.json of dqreg register, or 4x4 numbers as text from any program.

    \b
    dqreg evaluate result.json --truth my_case/truth.json
    dqreg evaluate pose.txt --truth true_pose.txt --target part.stl --within 0.05

    A symmetric part: "symmetries" in truth.json lists the 4x4 poses that map the part onto itself, "axis" a point and
    the direction of an axis of revolution.
    """
    from rich.console import Console
    from rich.table import Table

    from dqreg.atomic import require_writable, write_atomically
    from dqreg.compare import judge, read_pose
    from dqreg.compare.records import plain_values

    if out is not None:
        require_writable(out)
    T = read_pose(result)
    yardstick = _yardstick(truth, target, scan)
    score = judge(T, yardstick)
    console = Console(quiet=quiet, highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column()
    table.add_column(justify="right")
    figures = _figures(score, yardstick)
    for name, value in figures:
        table.add_row(name, value)
    console.print(table)
    if out is not None:
        import dataclasses

        values = {**dataclasses.asdict(score), "size": yardstick.size}
        write_atomically(out, json.dumps(plain_values(values), indent=1, allow_nan=False) + "\n")
        console.print(f"wrote {out}", markup=False, soft_wrap=True)
    return 1 if within is not None and not (score.kind == "rigid" and score.worst <= within) else 0


def _yardstick(truth: Path, target: Path | None, scan: Path | None) -> Yardstick:
    import numpy as np

    from dqreg.compare import Truth, from_pair, read_truth
    from dqreg.compare.judge import Yardstick
    from dqreg.errors import InputError

    known: Truth = read_truth(truth)
    beside = truth.parent / "part.stl"
    if target is None and truth.name == "truth.json" and beside.is_file():
        target = beside
    if target is None:
        if scan is not None:
            raise InputError("--scan needs --target, the part or cloud that its points shall lie on")
        # Without a part there is nothing but the frames: the origin is the one point that can be followed.
        return Yardstick(np.zeros((1, 3)), float("nan"), known.poses, known.axis)
    import dataclasses

    from dqreg.target import read_any

    made = from_pair(target if scan is None else scan, target, "identity", known)
    yardstick = made.yardstick
    if scan is None:
        return dataclasses.replace(yardstick, held_out=np.zeros((0, 3)))
    whole = read_any(scan, "scan")
    points = getattr(whole, "points", None)
    return yardstick if points is None else dataclasses.replace(yardstick, held_out=points)


def _figures(score: Score, yardstick: Yardstick) -> list[tuple[str, str]]:
    import math

    from dqreg.compare.tables import number

    rows = [("pose", score.kind), ("angle", f"{number(math.degrees(score.angle_rad))} deg")]
    if math.isnan(yardstick.size):
        return [*rows, ("offset at the origin", number(score.offset)), ("vertices", "give --target to measure them")]
    relative = number(score.worst / yardstick.size)
    rows += [
        ("offset at the middle of the part", number(score.offset)),
        ("vertex displacement, rms", number(score.rms)),
        ("vertex displacement, worst", f"{number(score.worst)} ({relative} of the size)"),
    ]
    if len(yardstick.held_out):
        rows += [
            ("scan points on the target", f"{100 * score.overlap:.1f} %"),
            ("their distance from it, rms", number(score.surface_rms)),
        ]
    return rows
