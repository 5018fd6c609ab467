"""`dqreg demo`: the main job on the part and scan that ship with the package, judged against the known truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dqreg.cli.exit_codes import code_of
from dqreg.cli.outputs import consoles, quiet_option, say, write_aligned
from dqreg.cli.values import FILE
from dqreg.kernels.compiling.second_process import start_where_nothing_is_kept

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg._arrays import FloatArray

# Tolerance of the report, three times the noise of the shipped scan.
TOLERANCE_MM = 0.15


@click.command()
@click.option("--out", type=FILE, default=Path("dqreg-demo"), show_default=True,
              help="Folder for the files it writes.")  # fmt: skip
@quiet_option
def demo(out: Path, quiet: bool) -> int:
    """Register the shipped scan of a bracket to its CAD model, from 20 degrees off.

    The scan is virtual: three views that see 58 % of the surface, 0.05 mm of noise, 2 % outliers. Its true pose is
    known, so the error can be printed.
    """
    start_where_nothing_is_kept()
    from dqreg._open3d import load_open3d
    from dqreg.files.atomic import require_folder, require_writable
    from dqreg.registration.register import register
    from dqreg.report import make_progress, print_summary
    from dqreg.synth import demo_case, load_case

    folder = require_folder(out)
    result_path, aligned_path, report_path = (
        require_writable(folder / name) for name in ("result.json", "aligned.ply", "report.html")
    )
    case = load_case(demo_case())
    console, _ = consoles(quiet=quiet, as_json=False)
    say(
        console,
        f"scan {case.scan.name} to {case.part.name} ({case.units}), initial pose {case.truth['start_angle_deg']:g} "
        f"degrees and {case.truth['start_offset']:.3g} {case.units} off",
    )
    with make_progress(console, quiet=quiet, unit=case.units) as progress:
        load_open3d()
        result = register(
            case.scan,
            case.part,
            case.T_start,
            source_units=case.units,
            target_units=case.units,
            observe=progress,
            # A start that leaves the scan unexplained is followed by a search.
            observe_search=progress.search,
        )
    print_summary(console, result)
    if math.isfinite(result.rms):
        _print_error(console, result.T_target_source, case.T_target_source, case.part, case.units, case.truth)
    result.save(result_path)
    say(console, f"wrote {result_path}")
    write_aligned(result, aligned_path, console)
    result.report(report_path, tolerance=TOLERANCE_MM, start=case.T_start)
    say(console, f"wrote {report_path}: open it in a browser")
    return code_of([result.verdict.level])


def _print_error(
    console: Console,
    T: FloatArray,
    T_truth: FloatArray,
    part: Path,
    units: str,
    truth: Mapping[str, object],
) -> None:
    from dqreg.files import read_mesh
    from dqreg.rigid import pose
    from dqreg.synth import rms_vertex_displacement, worst_vertex_displacement

    vertices = read_mesh(part).vertices
    angle = math.degrees(pose.angle_between(T, T_truth))
    worst = worst_vertex_displacement(T, T_truth, vertices)
    rms = rms_vertex_displacement(T, T_truth, vertices)
    say(
        console,
        f"against the truth: {angle:.2e} degrees; vertices of the part off by {rms:.2e} {units} rms, {worst:.2e} "
        f"{units} at worst (no method is nearer than {truth['cramer_rao_rms']:.2e} {units} rms on average: Cramer-Rao)",
    )
