"""`dqreg synth RECIPE`: a scan with known truth from a recipe."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dqreg.cli.outputs import as_json_option, consoles, print_json, quiet_option, say
from dqreg.cli.values import FILE

if TYPE_CHECKING:
    from dqreg.synth import Case


@click.command()
@click.argument("recipe", type=FILE)
@click.option("--out", type=FILE, help="Folder of the case  [default: the recipe's name].")
@click.option("--seed", type=int, metavar="N", help="Seed, instead of that of the recipe.")
@as_json_option
@quiet_option
def synth(recipe: Path, out: Path | None, seed: int | None, as_json: bool, quiet: bool) -> int:
    """Make the case that RECIPE (TOML) describes: scan.ply, part.stl, truth.json and the recipe itself.

    A recipe with the table [turntable], [room] or [street] makes many scans: scans/view00.ply and on, and truth.json
    with T_world_scan, for dqreg multiway and dqreg compare --multiway; of a street poses.txt too, for dqreg odometry.

    The same recipe and seed give the same bytes on one kind of processor and library version, and the same case to
    rounding elsewhere. An older case in the folder is replaced, other files are not.

    \b
    dqreg synth datasets_synth/bracket/recipe.toml --out my_bracket --seed 7
    dqreg synth datasets_synth/recipes/gear.toml
    dqreg synth datasets_synth/many/turntable.toml
    dqreg synth datasets_synth/many/street.toml --out street

    Exit codes: 0 made; 2 bad input.
    """
    from dqreg.files.json_records import read_json
    from dqreg.synth import read_recipe, write_case
    from dqreg.synth.many_cases import is_of_many, write_many

    console, shown = consoles(quiet=quiet, as_json=as_json)
    if is_of_many(recipe):
        with shown.status("scanning"):
            folder = write_many(out or recipe.stem, recipe, seed=seed)
        truth = read_json(folder / "truth.json", "the truth of a case")
        say(console, f"wrote {folder}: {len(truth['scans'])} scans, truth.json with T_world_scan and viewpoints")
        if as_json:
            print_json({"folder": str(folder), "truth": truth})
        return 0
    what = read_recipe(recipe)
    with shown.status("scanning"):
        case = write_case(out or Path(what.name), what, seed=seed)
    for line in _summary(case):
        say(console, line)
    if as_json:
        files = {"folder": case.folder, "scan": case.scan, "part": case.part, "recipe": case.recipe}
        print_json({**{name: str(path) for name, path in files.items()}, "truth": dict(case.truth)})
    return 0


def _summary(case: Case) -> list[str]:
    truth = case.truth
    on_part = truth["part_points"]
    share = f"{on_part / truth['points']:.0%}" if truth["points"] else "none"
    lines = [
        f"wrote {case.folder}: {case.scan.name}, {case.part.name}, truth.json, {case.recipe.name}",
        f"{truth['points']:,} points, {share} of them on the part ({truth['outliers']:,} outliers); the part has "
        f"{truth['faces']:,} faces and a diagonal of {case.part_diagonal:.4g} {case.units}",
        f"noise {case.range_sigma:g} {case.units}: no method can be nearer than {truth['cramer_rao_rms']:.2g} "
        f"{case.units} rms on average (Cramer-Rao)",
    ]
    if len(case.symmetric_truths) > 1 or truth["symmetry_axis"]:
        round_too = " besides any rotation about its axis" if truth["symmetry_axis"] else ""
        lines.append(f"the part is symmetric: {len(case.symmetric_truths)} poses are true{round_too}")
    return lines
