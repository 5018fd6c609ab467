"""`dqreg register SCAN TARGET`: one registration, from files to files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from dqreg.atomic import require_writable
from dqreg.errors import InputError
from dqreg.report import make_progress, print_summary
from dqreg.result import Registration
from dqreg.trust.deviation_files import require_suffix

UNITS = click.Choice(["mm", "cm", "m", "inch", "ft"])
FILE = click.Path(path_type=Path)


@click.command("register")
@click.argument("scan", type=FILE)
@click.argument("target", type=FILE)
@click.option("--start", default="none", show_default=True, metavar="none|identity|FILE", help="Where to begin: FILE "
              "holds a 4x4 T_target_source as text, or a result.json.")  # fmt: skip
@click.option("--out", type=FILE, help="Write the result as JSON.")
@click.option("--aligned", type=FILE, help="Write the scan in the target's frame as PLY.")
@click.option(
    "--deviations", type=FILE, help="Write every point with its signed deviation: coloured .ply, .csv or .npy."
)
@click.option(
    "--report", type=FILE, help="Write an HTML report: verdict, view, deviations; with --tolerance, pass or fail."
)
@click.option("--tolerance", type=float, metavar="LENGTH", help="Largest deviation allowed, target units: print the "
              "share within, and end the colours there.")  # fmt: skip
@click.option("--reach", type=float, metavar="LENGTH", help="Points farther off than this belong to something else and "
              "enter no figures, target units  [default: a quarter of --max-distance].")  # fmt: skip
@click.option("--method", default="auto", show_default=True, help="auto, dq, dq-points, svd or plane.")
@click.option("--effort", default="normal", show_default=True, help="fast, normal or best: points of the last level.")
@click.option("--max-distance", type=float, help="Largest distance of a pair, target units  [default: 0.2 sizes].")
@click.option("--max-angle", "max_angle_deg", type=float, default=60.0, show_default=True, help="Largest angle between "
              "normals, degrees.")  # fmt: skip
@click.option("--source-units", type=UNITS, help="Length unit of SCAN.")
@click.option("--target-units", type=UNITS, help="Length unit of TARGET.")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--no-acceleration", "accelerate", flag_value=False, default=True, help="Plain steps, no extrapolation.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def register_command(
    scan: Path,
    target: Path,
    start: str,
    out: Path | None,
    aligned: Path | None,
    deviations: Path | None,
    report: Path | None,
    tolerance: float | None,
    reach: float | None,
    quiet: bool,
    **options: Any,
) -> int:
    """Find the pose that puts SCAN on TARGET (a CAD mesh or another scan).

    \b
    dqreg register scan.ply part.stl
    dqreg register scan.pcd part.stl --start nominal.txt --out result.json
    dqreg register moved.ply fixed.ply --start identity --aligned moved_on_fixed.ply
    dqreg register scan.ply part.stl --deviations deviations.ply --tolerance 0.05
    dqreg register scan.ply part.stl --report report.html --tolerance 0.05
    """
    from dqreg.register import register

    # Asked before the work starts, so that no result is lost after it.
    for path in (out, aligned, deviations, report):
        if path is not None:
            require_writable(path)
    if deviations is not None:
        require_suffix(deviations)
    for name, length in (("--tolerance", tolerance), ("--reach", reach)):
        if length is not None and not length > 0.0:
            raise InputError(f"{name} must be a length above 0 in target units; got {length!r}")
    console = Console(quiet=quiet)
    with make_progress(console, quiet=quiet) as progress:
        began = read_start(start)
        result = register(scan, target, began, observe=progress, **options)
    print_summary(console, result)
    write_outputs(result, scan, out, aligned, console)
    if deviations is not None or tolerance is not None:
        tell_deviations(result, deviations, tolerance, reach, console)
    if report is not None:
        result.report(report, tolerance, reach=reach, start=began if isinstance(began, np.ndarray) else None)
        console.print(f"wrote {report}", highlight=False, markup=False, soft_wrap=True)
    return 0 if result.verdict.level == "accepted" else 1


def read_start(text: str) -> Any:
    """What ``--start`` means: None, "identity", or a pose read from a file.

    Parameters
    ----------
    text : str
        The option's value.

    Returns
    -------
    None, str or ndarray
        As `dqreg.register` takes it.

    Raises
    ------
    InputError
        If the file cannot be read as a pose.

    Examples
    --------
    >>> read_start("none"), read_start("identity")
    (None, 'identity')
    """
    if text == "none":
        return None
    if text == "identity":
        return text
    path = Path(text)
    if not path.is_file():
        raise InputError(f"--start must be none, identity or a file with a 4x4 pose; there is no file {text!r}")
    if path.suffix.lower() == ".json":
        loaded = Registration.load(path)
        loaded.inverse()  # raises in words where that result found no pose
        return loaded.T_target_source
    try:
        numbers = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"--start {text}: not a 4x4 pose of plain numbers ({error})") from error
    return numbers


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
        console.print(f"wrote {out}", highlight=False, markup=False, soft_wrap=True)
    if aligned is None:
        return
    if not np.isfinite(result.rms):
        console.print(f"not written: {aligned} (no pose was found)", highlight=False, markup=False, soft_wrap=True)
        return
    from dqreg.files import CloudData, read_geometry, write_cloud

    data = read_geometry(scan)
    points = data.points if isinstance(data, CloudData) else data.vertices
    normals = data.normals if isinstance(data, CloudData) else None
    if normals is not None:
        normals = normals @ result.T_target_source[:3, :3].T
    write_cloud(aligned, result.apply(points), normals)
    console.print(f"wrote {aligned}", highlight=False, markup=False, soft_wrap=True)


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
        told = f"not written: {path} (no pose was found)" if path else "no deviations: no pose was found"
        console.print(told, highlight=False, markup=False, soft_wrap=True)
        return
    from dqreg.cli.deviation_lines import deviation_lines

    with warnings.catch_warnings():
        # Why there are no signs stands in the first line.
        warnings.simplefilter("ignore", UserWarning)
        deviations = result.deviations(tolerance, reach=reach)
    for name, text in deviation_lines(deviations):
        console.print(f"{name:>10}  {text}", highlight=False, markup=False, soft_wrap=True)
    if path is not None:
        deviations.save(path)
        console.print(f"wrote {path}", highlight=False, markup=False, soft_wrap=True)
