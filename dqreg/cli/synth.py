"""`dqreg synth RECIPE`: a scan with known truth from a recipe."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console


@click.command()
@click.argument("recipe", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the case  [default: the recipe's name].")
@click.option("--seed", type=int, help="Instead of the recipe's own seed.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def synth(recipe: Path, out: Path | None, seed: int | None, quiet: bool) -> int:
    """Make the case that RECIPE (TOML) describes: scan.ply, part.stl, truth.json and the recipe itself.

    \b
    dqreg synth datasets_synth/bracket/recipe.toml --out my_bracket --seed 7
    """
    from dqreg.synth import read_recipe, write_case

    console = Console(quiet=quiet)
    with console.status("scanning"):
        case = write_case(out or Path(recipe.stem), read_recipe(recipe), seed=seed)
    console.print(f"wrote {case.folder}: {case.scan.name}, {case.part.name}, truth.json", highlight=False, markup=False)
    return 0
