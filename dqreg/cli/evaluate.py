"""`dqreg evaluate RESULT --truth FILE`: the errors of a pose against the truth."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.outputs import as_json_option, consoles, print_json, quiet_option, say
from dqreg.cli.overwriting import require_apart, require_ending
from dqreg.cli.values import FILE
from dqreg.errors import InputError, printable

if TYPE_CHECKING:
    from dqreg._arrays import FloatArray
    from dqreg.compare import GroundTruth, Score

# The inverse was written where that is ten times nearer to the truth than a pose that is wrong.
FAR_NEARER = 0.1


@click.command()
@click.argument("result", type=FILE)
@click.option("--truth", type=FILE, required=True, help="truth.json of a case, a result.json, or a 4x4 text.")
@click.option("--target", type=FILE, help="Part or cloud whose displacement is measured  [default: part.stl beside "
              "the truth].")  # fmt: skip
@click.option("--scan", type=FILE, help="Scan, to measure its distance from the target too.")
@click.option("--within", type=float, metavar="LENGTH", help="Exit with 1 if a point of the target is displaced by "
              "more than this, target units.")  # fmt: skip
@click.option("--out", type=FILE, help="Write the figures as JSON.")
@as_json_option
@quiet_option
def evaluate(
    result: Path,
    truth: Path,
    target: Path | None,
    scan: Path | None,
    within: float | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Measure the error of a pose: RESULT is a result.json of dqreg register, or 4x4 numbers as text from any program.

    \b
    dqreg evaluate result.json --truth my_case/truth.json
    dqreg evaluate pose.txt --truth true_pose.txt --target part.stl --within 0.05
    dqreg evaluate result.json --truth my_case/truth.json --json | jq .worst

    A symmetric part: "symmetries" in truth.json lists the 4x4 poses that map the part onto itself, "axis" a point and
    the direction of an axis of revolution.

    Exit codes: 0 measured and, with --within, no farther off; 1 farther off; 2 bad input.
    """
    from dqreg.compare import judge, read_pose
    from dqreg.files.atomic import require_writable, write_atomically
    from dqreg.files.strict_json import plain

    require_apart((result, truth, target, scan), {"--out": out})
    require_ending("--out", out, "JSON", (".json",))
    if within is not None and not within > 0.0:
        raise InputError(f"--within must be a length above 0, in target units; got {within!r}")
    if out is not None:
        require_writable(out)
    T = read_pose(result)
    known, unit = _ground_truth(truth, target, scan)
    unit = unit or _unit_of_result(result)
    score = judge(T, known)
    console, _ = consoles(quiet=quiet, as_json=as_json)
    good = score.kind == "rigid" and (within is None or score.worst <= within)
    _show(console, _figures(score, known, unit or "target units"))
    if _is_inverted(T, known, score):
        say(console, "note  its inverse is near the truth: one of the two files holds the inverse of T_target_source, "
                     "which maps source to target")  # fmt: skip
    if (factor := _factor_of_unit(T, known, score)) is not None:
        say(console, f"note  with its translation times {factor:g} it is near the truth: it is in another length unit")
    if within is not None:
        say(console, f"{'within' if good else 'NOT within'} {within:g} {unit or 'target units'}")
    values = {**dataclasses.asdict(score), "size": known.size, "units": unit}
    if out is not None:
        write_atomically(out, json.dumps(plain(values), indent=1, allow_nan=False) + "\n")
        say(console, f"wrote {out}")
    if as_json:
        print_json(values)
    return 1 if within is not None and not good else 0


def _is_inverted(T: FloatArray, known: GroundTruth, score: Score) -> bool:
    import numpy as np

    from dqreg.compare import judge
    from dqreg.rigid import pose

    if score.success is not False or score.kind != "rigid" or np.isnan(known.size):
        return False
    return judge(pose.inverse(T), known).worst < FAR_NEARER * score.worst


def _factor_of_unit(T: FloatArray, known: GroundTruth, score: Score) -> float | None:
    """What the translation times which the pose is near the truth, where it is that of a pair of units; else None."""
    import math

    from dqreg.compare import judge
    from dqreg.files.units import METRES
    from dqreg.rigid import pose

    if score.success is not False or score.kind != "rigid" or math.isnan(known.size):
        return None
    factors = {float(one / other) for one in METRES.values() for other in METRES.values() if one != other}
    scores = {k: judge(pose.from_parts(T[:3, :3], k * T[:3, 3]), known).worst for k in sorted(factors)}
    best = min(scores, key=lambda k: scores[k])
    return best if scores[best] < FAR_NEARER * score.worst else None


def _show(console: Any, figures: list[tuple[str, str]]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column()
    table.add_column(justify="right")
    for name, value in figures:
        table.add_row(name, Text(printable(value)))
    console.print(table)


def _ground_truth(truth: Path, target: Path | None, scan: Path | None) -> tuple[GroundTruth, str | None]:
    """What is known, and the unit of its lengths where a file says it."""
    import numpy as np

    from dqreg.compare import from_pair, read_truth
    from dqreg.compare.judge import GroundTruth
    from dqreg.geometry.opening import as_geometry

    true = read_truth(truth)
    beside = truth.parent / "part.stl"
    if target is None and truth.name == "truth.json" and beside.is_file():
        target = beside
    if target is None:
        if scan is not None:
            raise InputError("--scan needs --target, the part or cloud that its points shall lie on")
        # Without a part there is nothing but the frames: the origin is the one point that can be followed.
        return GroundTruth(np.zeros((1, 3)), float("nan"), true.poses, true.axis), true.units
    part = as_geometry(target, "target")
    unit = true.units or part.units
    known = from_pair(part if scan is None else scan, part, "identity", true).ground_truth
    if scan is None:
        return dataclasses.replace(known, held_out=np.zeros((0, 3))), unit
    whole = as_geometry(scan, "scan")
    points = getattr(whole, "points", None)
    return (known if points is None else dataclasses.replace(known, held_out=points)), unit


def _unit_of_result(path: Path) -> str | None:
    """The unit in which a result of `dqreg register` gives its lengths; None for a pose from elsewhere."""
    from dqreg.files.json_records import read_json
    from dqreg.files.poses import holds_object

    if not holds_object(path):
        return None
    settings = read_json(path, "a result").get("settings")
    named = settings.get("target_units") if isinstance(settings, dict) else None
    return named if isinstance(named, str) else None


def _figures(score: Score, known: GroundTruth, unit: str) -> list[tuple[str, str]]:
    import math

    from dqreg.compare.tables import number

    rows = [("pose", score.kind), ("angle", f"{number(math.degrees(score.angle_rad))} deg")]
    if math.isnan(known.size):
        return [
            *rows,
            ("offset at the origin", f"{number(score.offset)} {unit}"),
            ("vertices", "give --target to measure them"),
        ]
    relative = number(score.worst / known.size)
    rows += [
        ("offset at the middle of the part", f"{number(score.offset)} {unit}"),
        ("vertex displacement, rms", f"{number(score.rms)} {unit}"),
        ("vertex displacement, worst", f"{number(score.worst)} {unit} ({relative} of the size)"),
    ]
    if len(known.held_out):
        rows += [
            ("scan points on the target", f"{100 * score.overlap:.1f} %"),
            ("their distance from it, rms", f"{number(score.surface_rms)} {unit}"),
        ]
    return rows
