"""`dqreg show RESULT`: pictures of a saved result without a display, its report, or a window."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.outputs import as_json_option, consoles, deviation_record, port_option, print_json, quiet_option, say
from dqreg.cli.values import FILE, UNITS
from dqreg.errors import InputError, printable

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.registration.result.result import Registration
    from dqreg.report.report_data import ReportData

VIEWS = "best"


@click.command()
@click.argument("result", type=FILE)
@click.option("--source", type=FILE, help="The scan  [default: the file that the result names].")
@click.option("--target", type=FILE, help="The part or other scan  [default: the file that the result names].")
@click.option("--save", type=FILE, help="Write a picture, .png or .jpg; needs no display.")
@click.option("--views", default=VIEWS, show_default=True, metavar="LIST", help="Views between commas: best, iso, "
              "iso-back, front, back, left, right, top, bottom ...; the prefix before: or after: shows the scan at its "
              "initial or final pose, else its deviations. Example: before:iso,iso,top.")  # fmt: skip
@click.option("--report", type=FILE, help="Write the report: HTML or PDF.")
@click.option("--tolerance", type=float, metavar="LENGTH", help="Largest deviation allowed, target units: the end "
              "of the colour scale.")  # fmt: skip
@click.option("--display-units", type=UNITS, help="Length unit of all that is shown, and of --tolerance; the sentences "
              "of the verdict stay in the target's  [default: TARGET's].")  # fmt: skip
@click.option("--start", type=FILE, metavar="FILE", help="Initial pose of the registration, 4x4, for before: views.")
@click.option("--serve", is_flag=True, help="Show it in the browser, on this machine alone, until Ctrl-C: iterations, "
              "alternatives, the ellipsoid of the pose. Works over ssh.")  # fmt: skip
@port_option
@as_json_option
@quiet_option
def show(
    result: Path,
    source: Path | None,
    target: Path | None,
    save: Path | None,
    views: str,
    report: Path | None,
    tolerance: float | None,
    display_units: str | None,
    start: Path | None,
    serve: bool,
    port: int,
    as_json: bool,
    quiet: bool,
) -> int:
    """Show RESULT, the JSON that dqreg register --out wrote.

    \b
    dqreg show result.json --save view.png
    dqreg show result.json --save sides.png --views before:iso,iso,iso-back,top --start nominal.txt
    dqreg show result.json --report report.html --tolerance 0.05
    dqreg show result.json --report report.html --display-units mm --tolerance 0.05
    dqreg show result.json --json                   verdict, pose and deviations; opens no window
    dqreg show result.json --serve                  in the browser, also of another machine through ssh
    dqreg show result.json                          a window, where there is a display

    Exit codes: 0 shown, whatever the verdict; 2 bad input.
    """
    from dqreg.registration.result.result import Registration
    from dqreg.report.page import to_html
    from dqreg.report.page_file import page_path, write_page
    from dqreg.report.pictures import parse_panels, picture_path, save_picture
    from dqreg.report.report_data import collect
    from dqreg.report.window import open_window, require_display

    # Everything that can be refused is asked before the work.
    panels = parse_panels(views)
    if save is not None:
        picture_path(save)
    if report is not None:
        page_path(report)
    in_a_window = save is None and report is None and not as_json and not serve
    loaded = Registration.load(result)
    if in_a_window:
        require_display()
    attached, began = attach(loaded, source, target, display_units, _start_pose(start))
    assert attached.inputs is not None
    if changed := attached.settings.get("changed"):
        click.echo(f"dqreg: {printable(changed)}", err=True)
    console, _ = consoles(quiet=quiet, as_json=as_json)
    data = collect(attached, attached.inputs, tolerance, began)
    if report is not None:
        write_page(report, to_html(attached, data))
        say(console, f"wrote {report}")
    if in_a_window:
        open_window(data)
    if save is not None:
        save_picture(data, save, panels)
        say(console, f"wrote {save}")
    if as_json:
        print_json(_record(attached, data, [path for path in (report, save) if path is not None]))
    if serve:
        _serve(console, data, port)
    return 0


def _serve(console: Console, data: ReportData, port: int) -> None:
    from dqreg.report.live_result import serve_result
    from dqreg.report.live_server import wait, where

    server = serve_result(data, port).server
    say(console, where(server))
    wait(server)


def _record(result: Registration, data: ReportData, files: list[Path]) -> dict[str, Any]:
    """What a picture shows, for programs."""
    deviations = None
    if data.deviations is not None:
        trusted = result.verdict.level == "accepted"
        deviations = deviation_record(data.deviations, data.decision, trusted=trusted)
    return {
        "verdict": result.verdict,
        "T_target_source": result.T_target_source,
        "units": result.settings.get("target_units"),
        "changed": result.settings.get("changed"),
        "deviations": deviations,
        "files": [str(path) for path in files],
    }


def attach(
    result: Registration, source: Path | None, target: Path | None, display_units: str | None, start: Any
) -> tuple[Registration, Any]:
    """A loaded result with its two sides, from the files given or those that it names, and its start, in a unit."""
    from dqreg.files.side_digests import CHANGED, DIGESTS, changed_words
    from dqreg.registration.result.display_unit import in_unit, shown_target

    missing = [name for name in ("max_distance", "centre", "diagonal") if name not in result.settings]
    if missing:
        raise InputError(
            f"the result does not say its {' and '.join(missing)}; it was changed, or is not of dqreg register"
        )
    own = result.settings.get("target_units")
    if display_units is not None and own is None:
        raise InputError(
            f"--display-units {display_units}: the result names no length unit; register with --target-units"
        )
    scan, part = (_side(result, name, given) for name, given in (("source", source), ("target", target)))
    if changed := changed_words(result.settings.get(DIGESTS), {"source": scan, "target": part}):
        result = dataclasses.replace(result, settings={**result.settings, CHANGED: changed})
    unit = shown_target(part, own, display_units)
    if unit.scale == 1.0:
        return result.attached(scan, part), start
    shown = in_unit(result, str(unit.units))
    with unit.source_units(scan, result.settings.get("source_units")) as source_units:
        shown = dataclasses.replace(shown, settings={**shown.settings, "source_units": source_units})
        return shown.attached(scan, unit.geometry), unit.start(start)


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
    from dqreg.files.poses import read_start

    return read_start(start)
