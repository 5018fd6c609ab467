"""What a registration leaves behind, on the screen and in files."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.inspection import Deviations
    from dqreg.registration.result import Registration

as_json_option = click.option("--json", "as_json", is_flag=True, help="The answer as JSON on standard output, and "
                              "nothing else there.")  # fmt: skip


def consoles(*, quiet: bool, as_json: bool, width: int | None = None) -> tuple[Console, Console]:
    """Where the answer is told to people, and where the progress is shown.

    >>> [console.quiet for console in consoles(quiet=False, as_json=True)][0]
    True
    """
    from rich.console import Console

    told = Console(stderr=as_json, quiet=quiet or as_json, highlight=False)
    shown = Console(stderr=as_json, quiet=quiet, highlight=False)
    shown.quiet = quiet or (as_json and not shown.is_terminal)
    if width is not None:
        for console in (told, shown):
            if not console.is_terminal:
                console.width = width
    return told, shown


def print_json(value: Any) -> None:
    """Print anything that the records of a result are made of as strict JSON to standard output.

    >>> print_json({"rms": float("nan"), "units": "mm"})
    {
     "rms": null,
     "units": "mm"
    }
    """
    from dqreg.files.strict_json import plain

    click.echo(json.dumps(plain(value), indent=1, allow_nan=False))


def write_outputs(result: Registration, out: Path | None, aligned: Path | None, console: Console) -> None:
    """Write the result and the moved scan."""
    if out is not None:
        result.save(out)
        say(console, f"wrote {out}")
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
    result: Registration, path: Path | None, tolerance: float | None, reach: float | None, console: Console
) -> Deviations | None:
    """Print the deviations of a result and write them."""
    if not math.isfinite(result.rms):
        say(console, f"not written: {path} (no pose was found)" if path else "no deviations: no pose was found")
        return None
    from dqreg.cli.deviation_lines import deviation_lines

    with warnings.catch_warnings(), console.status("measuring deviations") as status:

        def show(done: int, total: int) -> None:
            status.update(f"measuring deviations: {done:,} of {total:,} points")

        # Why there are no signs stands in the first line.
        warnings.simplefilter("ignore", UserWarning)
        deviations = result.deviations(tolerance, reach=reach, progress=show)
    for name, text in deviation_lines(deviations):
        say(console, f"{name:>10}  {text}")
    if path is not None:
        deviations.save(path)
        say(console, f"wrote {path}")
    return deviations


def deviation_record(deviations: Deviations) -> dict[str, Any]:
    """The figures of `tell_deviations` as plain values."""
    import dataclasses

    from dqreg.cli.deviation_lines import PLACES

    return {
        "units": deviations.units,
        "signed": deviations.signed,
        "reason": deviations.reason,
        "reach": deviations.reach,
        "summary": dataclasses.asdict(deviations.summary()),
        "bands": None if deviations.tolerance is None else dataclasses.asdict(deviations.bands()),
        "worst": [dataclasses.asdict(place) for place in deviations.worst(PLACES)],
    }


def tell_report(
    result: Registration,
    path: Path,
    tolerance: float | None,
    reach: float | None,
    start: Any,
    console: Console,
    deviations: Deviations | None = None,
) -> None:
    """Write the HTML report of a result."""
    import numpy as np

    from dqreg.report.page import write_report

    T_start = start if isinstance(start, np.ndarray) else None
    with console.status("writing the report"):
        write_report(result, path, tolerance, reach=reach, start=T_start, deviations=deviations)
    say(console, f"wrote {path}")


def say(console: Console, text: str) -> None:
    """Print a line as it is: no markup, no colours, no breaks."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)
