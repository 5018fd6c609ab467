"""What a registration leaves behind, on the screen and in files."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.result import Registration


def print_json(result: Registration) -> None:
    """Print the result as JSON to standard output, as `Registration.save` writes it.

    Parameters
    ----------
    result : Registration
        The answer.
    """
    click.echo(json.dumps(result.to_dict(), indent=1, allow_nan=False))


def write_outputs(result: Registration, scan: Path, out: Path | None, aligned: Path | None, console: Console) -> None:
    """Write the result and the moved scan.

    Parameters
    ----------
    result : Registration
        The answer.
    scan : Path
        Source file, read again for its points.
    out, aligned : Path or None
        Where to; None writes nothing.
    console : Console
        Told what was written.
    """
    if out is not None:
        result.save(out)
        say(console, f"wrote {out}")
    if aligned is None:
        return
    if not np.isfinite(result.rms):
        say(console, f"not written: {aligned} (no pose was found)")
        return
    from dqreg.files import CloudData, read_geometry, write_cloud

    with console.status("writing the aligned scan"):
        data = read_geometry(scan)
        points = data.points if isinstance(data, CloudData) else data.vertices
        normals = data.normals if isinstance(data, CloudData) else None
        if normals is not None:
            normals = normals @ result.T_target_source[:3, :3].T
        write_cloud(aligned, result.apply(points), normals)
    say(console, f"wrote {aligned}")


def tell_deviations(
    result: Registration, path: Path | None, tolerance: float | None, reach: float | None, console: Console
) -> None:
    """Print the deviations of a result and write them.

    Parameters
    ----------
    result : Registration
        The answer, with both sides.
    path : Path or None
        Where to; None writes nothing.
    tolerance, reach : float or None
        As in `Registration.deviations`.
    console : Console
        Told the figures.
    """
    if not np.isfinite(result.rms):
        say(console, f"not written: {path} (no pose was found)" if path else "no deviations: no pose was found")
        return
    from dqreg.cli.deviation_lines import deviation_lines

    with warnings.catch_warnings(), console.status("measuring deviations"):
        # Why there are no signs stands in the first line.
        warnings.simplefilter("ignore", UserWarning)
        deviations = result.deviations(tolerance, reach=reach)
    for name, text in deviation_lines(deviations):
        say(console, f"{name:>10}  {text}")
    if path is not None:
        deviations.save(path)
        say(console, f"wrote {path}")


def tell_report(
    result: Registration, path: Path, tolerance: float | None, reach: float | None, start: Any, console: Console
) -> None:
    """Write the HTML report of a result.

    Parameters
    ----------
    result : Registration
        The answer.
    path : Path
        Where to.
    tolerance, reach : float or None
        As in `Registration.report`.
    start : ndarray, str or None
        Where the registration began; shown where it is a pose.
    console : Console
        Told what was written.
    """
    with console.status("writing the report"):
        result.report(path, tolerance, reach=reach, start=start if isinstance(start, np.ndarray) else None)
    say(console, f"wrote {path}")


def say(console: Console, text: str) -> None:
    """Print a line as it is: no markup, no colours, no breaks.

    Parameters
    ----------
    console : Console
        Where to.
    text : str
        What.
    """
    console.print(text, highlight=False, markup=False, soft_wrap=True)
