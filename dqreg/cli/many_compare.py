"""`dqreg compare --multiway`: engines that place many scans, against known poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.cli.outputs import print_json, say
from dqreg.cli.overwriting import require_apart
from dqreg.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console


def run_many(
    console: Console, shown: Console, inputs: tuple[Path, ...], options: dict[str, Any], *, as_json: bool
) -> int:
    """Compare on the scans given; --truth holds T_world_scan of each, as KITTI, TUM or a result."""
    import dataclasses
    import json

    import numpy as np

    from dqreg.files.atomic import require_writable, write_atomically
    from dqreg.files.strict_json import plain
    from dqreg.geometry import Mesh
    from dqreg.geometry.opening import as_geometry
    from dqreg.multiway.pairwise.starts import read_starts_file
    from dqreg.multiway.peers import compare_many
    from dqreg.multiway.scores import many_table
    from dqreg.report.table import print_tables, to_markdown

    for name in ("report", "csv", "plots", "sweep", "engines", "files", "kinds", "seeds"):
        if options[name]:
            raise InputError(f"--{name} does not go with --multiway; --out, --markdown and --json do")
    if options["truth"] is None:
        raise InputError("--multiway needs --truth: the true poses T_world_scan, one a scan (KITTI, TUM or a result)")
    goals = {f"--{name}": options[name] for name in ("out", "markdown")}
    require_apart((*inputs, options["truth"]), goals)
    for goal in goals.values():
        if goal is not None:
            require_writable(goal)
    truth = np.array(read_starts_file(options["truth"], len(inputs)))
    if len(truth) != len(inputs):
        raise InputError(f"--truth has {len(truth)} poses for {len(inputs)} scans")
    if not np.isfinite(truth).all():
        raise InputError(f"{options['truth']} holds scans without a pose; --truth has one for each scan")
    clouds = []
    for path in inputs:
        geometry = as_geometry(path, "scan")
        if isinstance(geometry, Mesh):
            raise InputError(f"{path} is a mesh; --multiway compares on clouds")
        clouds.append(geometry)
    scores = compare_many(clouds, truth, observe=lambda name: say(shown, f"running {name}"), workers=options["workers"])
    table = many_table(scores, len(clouds))
    print_tables(console, [table])
    if options["markdown"] is not None:
        write_atomically(options["markdown"], to_markdown([table]))
        say(console, f"wrote {options['markdown']}")
    record = {"scores": [dataclasses.asdict(each) for each in scores]}
    if options["out"] is not None:
        write_atomically(options["out"], json.dumps(plain(record), indent=1, allow_nan=False) + "\n")
        say(console, f"wrote {options['out']}")
    if as_json:
        print_json(record)
    return 0
