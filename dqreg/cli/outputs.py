"""What a registration leaves behind, on the screen and in files."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import click

from dqreg.errors import InputError, printable

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.inspection import Decision, Deviations, Tolerance
    from dqreg.registration.result.result import Registration

as_json_option = click.option("--json", "as_json", is_flag=True, help="The result as JSON on standard output, and "
                              "nothing else there.")  # fmt: skip
port_option = click.option("--port", type=int, metavar="N", default=8080, show_default=True, help="Port of the page in "
                           "the browser; the next free one if taken.")  # fmt: skip
quiet_option = click.option("--quiet", is_flag=True, help="Print nothing but errors.")

# Places of deviations that are worth a line on the screen; the file holds them all.
SHOWN_PLACES = 5


def consoles(*, quiet: bool, as_json: bool, width: int | None = None, apart: bool = False) -> tuple[Console, Console]:
    """Where the answer is told to people, and where the progress is shown.

    >>> [console.quiet for console in consoles(quiet=False, as_json=True)][0]
    True
    """
    from dqreg.cli.pipes import Dispensable
    from dqreg.cli.pipes import PatientConsole as Console
    from dqreg.kernels.compiling import second_process

    if quiet:
        second_process.tell(tells=False)
    told = Console(stderr=as_json, quiet=quiet or as_json, highlight=False)
    # A pipe gets the answer, not the iterations before it.
    beside = as_json or (apart and not told.is_terminal)
    stream = Dispensable(sys.stderr) if beside and sys.stderr is not None else None
    shown = Console(file=cast("IO[str] | None", stream), stderr=beside, quiet=quiet, highlight=False)
    shown.quiet = quiet or (as_json and not shown.is_terminal)
    if width is not None:
        for console in (told, shown):
            if not console.is_terminal:
                console.width = width
    return told, shown


def read_head(words: Sequence[str]) -> dict[str, str]:
    """Fields of a report's head.

    >>> read_head(["serial=7", "note=a=b"])
    {'serial': '7', 'note': 'a=b'}
    """
    found = {}
    for text in words:
        name, mark, value = text.partition("=")
        if not (mark and name.strip()):
            raise InputError(f"--head must be NAME=VALUE, such as serial=0007; got {text!r:.100}")
        found[name.strip()] = value.strip()
    return found


def require_below_reach(tolerance: Tolerance | None, reach: float | None) -> None:
    """Refuse, before the work, a tolerance that nothing could violate."""
    if tolerance is not None and reach is not None and tolerance.size >= reach:
        raise InputError(
            f"--tolerance {tolerance.size:g} is not below --reach {reach:g}: points farther off are left out, so that "
            "nothing could fail; check the unit of the tolerance, or give a larger reach"
        )


def print_json(value: Any) -> None:
    """Print anything that the records of a result are made of as strict JSON to standard output.

    >>> print_json({"rms": float("nan"), "units": "mm"})
    {
     "rms": null,
     "units": "mm"
    }
    """
    from dqreg.cli.pipes import into_the_void
    from dqreg.files.strict_json import plain

    try:
        click.echo(json.dumps(plain(value), indent=1, allow_nan=False))
    except BrokenPipeError:
        # Who reads has enough; the exit code is still that of the answer.
        into_the_void()


def write_result(result: Registration, out: Path) -> None:
    """Write a result, or its matrix alone, as the name says; all digits are kept."""
    if out.suffix.lower() != ".txt":
        result.save(out)
        return
    from dqreg.files.atomic import write_atomically

    write_atomically(out, "".join(" ".join(map(repr, row)) + "\n" for row in result.T_target_source.tolist()))


def tell_result(
    result: Registration, native: Registration, out: Path | None, aligned: Path | None, console: Console
) -> None:
    """Write the result in the target's unit, and print its summary: whatever goes wrong with one, the other is done.

    And write the moved scan.
    """
    from dqreg.report import print_summary

    try:
        if out is not None:
            write_result(native, out)
    finally:
        print_summary(console, result)
    if out is not None:
        say(console, f"wrote {out}")
    write_aligned(native, aligned, console)


def write_aligned(result: Registration, aligned: Path | None, console: Console) -> None:
    """Write the moved scan."""
    if aligned is None:
        return
    if not math.isfinite(result.rms):
        say(console, f"not written: {aligned} (no pose was found)")
        return
    from dqreg.files import write_cloud

    assert result.inputs is not None
    with console.status("writing the aligned scan"):
        points, normals = result.inputs.source.as_given()
        if normals is not None:
            normals = normals @ result.T_target_source[:3, :3].T
        write_cloud(aligned, result.apply(points), normals)
    say(console, f"wrote {aligned}")


def tell_deviations(
    result: Registration, path: Path | None, tolerance: Tolerance | None, console: Console, **options: Any
) -> Deviations | None:
    """Print the deviations of a result and write them."""
    if not math.isfinite(result.rms):
        say(console, f"not written: {path} (no pose was found)" if path else "no deviations: no pose was found")
        return None
    from dqreg.registration.result.part_inspection import deviations_within

    with console.status("measuring deviations") as status:

        def show(done: int, total: int) -> None:
            status.update(f"measuring deviations: {done:,} of {total:,} points")

        deviations = deviations_within(result, tolerance, progress=show, **options)
    for name, text in deviation_lines(deviations):
        say(console, f"{name:>10}  {text}")
    if path is not None:
        deviations.save(path)
        say(console, f"wrote {path}")
    return deviations


def deviation_lines(deviations: Deviations) -> list[tuple[str, str]]:
    """Names and values to print.

    >>> import numpy as np
    >>> from dqreg.inspection import Deviations
    >>> points, faces = np.zeros((1000, 3)), np.zeros(1000, dtype=np.int64)
    >>> values = np.full(1000, 0.02)
    >>> found = Deviations(values, points, points, faces, True, "positive outside", "mm", tolerance=0.05, apart=2.0)
    >>> for name, text in deviation_lines(found):
    ...     print(f"{name}: {text}")
    deviations: 1000 points; positive outside
    deviation: p50 0.02 mm, p95 0.02 mm, max 0.02 mm; mean +0.02 mm, rms 0.02 mm
    tolerance: ±0.05 mm: 100.00 % within, 0.00 % below, 0.00 % above
    worst: +0.02 mm at (0, 0, 0) mm, 1000 points around it
    """
    from dqreg.report.page_tables import reach_words
    from dqreg.report.text import unit_words

    unit = unit_words(deviations.units)
    summary = deviations.summary()
    counted = f"{summary.count} points"
    if summary.beyond:
        counts = deviations.counts
        others = [
            (counts.excluded, "excluded"),
            (counts.beyond_reach, reach_words(deviations, unit.strip())),
            (counts.other_surfaces, "on surfaces that leave the part (--keep counts them)"),
            (counts.outliers, "outliers"),
        ]
        left_out = "; ".join(f"{number} {words}" for number, words in others if number)
        counted = f"{summary.count} of {counts.total} points (left out: {left_out})"
    sign = "+" if deviations.signed else ""
    lines = [("deviations", f"{counted}; {deviations.reason}")]
    if not summary.count:
        return lines
    lines.append(
        (
            "deviation",
            f"p50 {summary.p50:.4g}{unit}, p95 {summary.p95:.4g}{unit}, max {summary.max:.4g}{unit}; "
            f"mean {summary.mean:{sign}.4g}{unit}, rms {summary.rms:.4g}{unit}",
        )
    )
    if deviations.tolerance is not None and deviations.allowed is None:
        bands = deviations.bands()
        below = f"{100 * bands.below:.2f} % below, " if deviations.signed else ""
        mark = "±" if deviations.signed else ""
        # Never rounded to all.
        within = f"{100 * bands.within:.2f}" if bands.within in (1.0, min(bands.within, 0.99995)) else "> 99.99"
        shares = f"{within} % within, {below}{100 * bands.above:.2f} % above"
        lines.append(("tolerance", f"{mark}{bands.tolerance:g}{unit}: {shares}"))
    for place in deviations.worst(SHOWN_PLACES):
        where = ", ".join(f"{x:.7g}" for x in place.position)
        lines.append(("worst", f"{place.value:{sign}.4g}{unit} at ({where}){unit}, {place.points} points around it"))
    return lines


def tell_decision(found: Decision, deviations: Deviations, console: Console, result: Registration) -> None:
    """Print whether the part is within its tolerance, and why."""
    from dqreg.report.decision_tables import decision_words, shape_words
    from dqreg.report.inspection_table import outcome_markup
    from dqreg.report.text import tolerance_text

    unit = deviations.units or ""
    against = tolerance_text(found, unit).replace("−", "-") + shape_words(result)
    said = outcome_markup(found.outcome, trusted=result.verdict.level == "accepted")
    console.print(f"{said}: part against {against}", highlight=False)
    for words in decision_words(found, unit, deviations.signed, deviations.noise):
        say(console, f"  {words}")


def deviation_record(
    deviations: Deviations, decision: Decision | None = None, *, trusted: bool = False
) -> dict[str, Any]:
    """The figures of `tell_deviations` as plain values."""
    from dqreg.inspection.decision.decision import decision_record

    return {
        "units": deviations.units,
        "signed": deviations.signed,
        "reason": deviations.reason,
        "reach": deviations.reach,
        "summary": dataclasses.asdict(deviations.summary()),
        "bands": None if deviations.tolerance is None else dataclasses.asdict(deviations.bands()),
        "worst": [dataclasses.asdict(place) for place in deviations.worst(SHOWN_PLACES)],
        "counts": dataclasses.asdict(deviations.counts),
        "decision": decision and decision_record(decision, deviations.origin) | {"alignment_trusted": trusted},
    }


def tell_report(
    result: Registration,
    path: Path,
    reach: float | None,
    start: Any,
    console: Console,
    deviations: Deviations | None,
    decision: Decision | None,
) -> None:
    """Write the HTML report of a result."""
    import numpy as np

    from dqreg.report.page import write_report

    T_start = start if isinstance(start, np.ndarray) else None
    with console.status("writing the report"):
        write_report(result, path, reach=reach, start=T_start, deviations=deviations, decision=decision)
    say(console, f"wrote {path}")


def say(console: Console, text: str) -> None:
    """Print a line as it is: no markup, no colours, no breaks."""
    from dqreg.cli.pipes import into_the_void

    try:
        console.print(printable(text), highlight=False, markup=False, soft_wrap=True)
    except BrokenPipeError:
        into_the_void()
    except OSError as error:
        # What is left in the stream would fail once more when Python ends.
        into_the_void()
        raise InputError(f"cannot write to the standard output: {error.strerror or error}; add --quiet") from error
