"""`dqreg compare --sweep trust`: how often the verdict is right, kind by kind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.outputs import say

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from dqreg.compare.trust import TrustProgress, TrustSweep
    from dqreg.report.work_bar import WorkBar

DEFAULT_SEEDS = 10
DEFAULT_OUT = "dqreg-compare-trust.json"


def run_trust_sweep(
    console: Console, shown: Console, options: dict[str, Any], command: str, *, as_json: bool
) -> int | None:
    """Run the sweep, show and write what came of it; None where it was stopped."""
    from dqreg.compare.output import Goals
    from dqreg.compare.trust import output, trust_sweep
    from dqreg.report.table import print_tables
    from dqreg.report.work_bar import WorkBar

    kinds = [name for names in options["kinds"] for name in names.split(",") if name]
    seeds = options["seeds"] or DEFAULT_SEEDS
    # A single task is looked at, and carried out anew each time.
    alone = len(kinds) == 1 and seeds == 1
    out = options["out"] if alone or options["out"] is not None else Path(DEFAULT_OUT)
    goals = Goals(out=out, **{name: options[name] for name in ("report", "markdown", "csv")})
    goals.check()
    try:
        with WorkBar(shown) as bar:
            found = trust_sweep(
                kinds,
                seeds=seeds,
                first_seed=options["first_seed"] or 0,
                workers=options["workers"] or 2,
                out=goals.lines,
                observe=_told(bar, shown),
            )
    except KeyboardInterrupt:
        kept = f"; the tasks so far are in {goals.lines}: the same command resumes from there" if goals.lines else ""
        click.echo(f"dqreg: stopped by the user{kept}", err=True)
        return None
    print_tables(console, output.tables_of(found))
    console.print()
    console.print(output.note_of(found), style="dim", markup=False, soft_wrap=True)
    if len(found.trials) == 1:
        _sentences(console, found)
    if options["fit_confidence"]:
        _fit_confidence(console, found)
    for path in output.write(found, goals, command):
        say(console, f"wrote {path}")
    if as_json:
        click.echo(output.to_json(found), nl=False)
    return 0


def _fit_confidence(console: Console, found: TrustSweep) -> None:
    """Show the map fitted anew, with its calibration error on seeds that it was not fitted to, where there are two."""
    from dqreg.compare.trust.calibration import as_code, cross_validated, fit_confidence, rescale_confidence

    for words, fit in (("all weights", fit_confidence), ("shifted alone", rescale_confidence)):
        say(console, as_code(*fit(found.trials)))
        if found.seeds[1] > 1:
            error = cross_validated(found.trials, fit)
            say(
                console,
                f"{words}: calibration error {100 * error.error:.1f} % on seeds that it was not fitted to, "
                f"{100 * error.expected_by_chance:.1f} % by chance",
            )


def list_kinds(console: Console) -> None:
    """Show the kinds of task."""
    from dqreg.compare.trust.kinds import KINDS

    for kind in KINDS.values():
        say(console, f"{kind.name:<24} {kind.group:<8} {kind.words}")


def _sentences(console: Console, found: TrustSweep) -> None:
    one = found.trials[0]
    say(console, f"{one.kind}, seed {one.seed}: {one.level}, pose {'right' if one.right else 'wrong'}: {one.reason}")


def _told(bar: WorkBar, console: Console) -> Callable[[TrustProgress], None]:
    """Shows where a sweep is, and each wrong accept as it comes."""

    def tell(progress: TrustProgress) -> None:
        one = progress.trial
        bar.show(progress.done, progress.total, progress.seconds_left, one.kind if one else "")
        if one is not None and one.wrong_accept:
            say(console, f"accepted though wrong: {one.kind}, seed {one.seed}: {one.reason}")

    return tell
