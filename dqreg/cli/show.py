"""`dqreg show RESULT`: pictures of a saved result without a display, its report, or a window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.console import Console

from dqreg.atomic import require_writable
from dqreg.errors import InputError
from dqreg.result import Registration

FILE = click.Path(path_type=Path)
VIEWS = "best"


@click.command()
@click.argument("result", type=FILE)
@click.option("--source", type=FILE, help="The scan  [default: the file that the result names].")
@click.option("--target", type=FILE, help="The part or other scan  [default: the file that the result names].")
@click.option("--save", type=FILE, help="Write a picture, .png or .jpg; needs no display.")
@click.option("--views", default=VIEWS, show_default=True, metavar="LIST", help="Panels between commas: best, iso, "
              "iso-back, front, back, left, right, top, bottom ...; before: or after: ahead of a view shows the scan "
              "there, else its deviations. Example: before:iso,iso,top.")  # fmt: skip
@click.option("--report", type=FILE, help="Write the HTML report.")
@click.option("--tolerance", type=float, metavar="LENGTH", help="Largest deviation allowed, target units: the colours "
              "end there.")  # fmt: skip
@click.option("--start", type=FILE, help="The 4x4 pose at which the registration began, for before: views.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def show(
    result: Path,
    source: Path | None,
    target: Path | None,
    save: Path | None,
    views: str,
    report: Path | None,
    tolerance: float | None,
    start: Path | None,
    quiet: bool,
) -> int:
    """Look at RESULT, the JSON that dqreg register --out wrote.

    \b
    dqreg show result.json --save view.png
    dqreg show result.json --save sides.png --views before:iso,iso,iso-back,top --start nominal.txt
    dqreg show result.json --report report.html --tolerance 0.05
    dqreg show result.json                          a window, where there is a display
    """
    from dqreg.report.pictures import parse_panels, picture_path, save_picture
    from dqreg.report.story import tell
    from dqreg.report.window import open_window, require_display

    # Everything that can be refused is asked before the work.
    panels = parse_panels(views)
    if save is not None:
        picture_path(save)
    if report is not None:
        require_writable(report)
    if save is None and report is None:
        require_display()
    began = _start_pose(start)
    attached = attach(Registration.load(result), source, target)
    assert attached.inputs is not None
    console = Console(quiet=quiet)
    if report is not None:
        attached.report(report, tolerance, start=began)
        console.print(f"wrote {report}", highlight=False, markup=False, soft_wrap=True)
        if save is None:
            return 0
    story = tell(attached, attached.inputs, tolerance, began)
    if save is None:
        open_window(story)
        return 0
    save_picture(story, save, panels)
    console.print(f"wrote {save}", highlight=False, markup=False, soft_wrap=True)
    return 0


def attach(result: Registration, source: Path | None, target: Path | None) -> Registration:
    """A loaded result with its two sides, from the files given or those that it names.

    Parameters
    ----------
    result : Registration
        As loaded.
    source, target : Path or None
        Files to use instead of those named.

    Returns
    -------
    Registration
        With inputs.

    Raises
    ------
    InputError
        If a side has no file; the message names the option.
    """
    sides = {name: _side(result, name, given) for name, given in (("source", source), ("target", target))}
    return result.attached(**sides)


def _side(result: Registration, name: str, given: Path | None) -> Path:
    if given is not None:
        return given
    named = result.settings.get(name)
    if isinstance(named, str) and Path(named).is_file():
        return Path(named)
    words = f"{named!r}, and there is no such file here" if named else "no file"
    raise InputError(f"the result names as its {name} {words}; give it with --{name} FILE")


def _start_pose(start: Path | None) -> Any:
    if start is None:
        return None
    from dqreg.cli.register import read_start

    return read_start(str(start))
