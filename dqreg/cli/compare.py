"""`dqreg compare`: every engine on the same tasks, judged by one judge."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.exit_codes import STOPPED_CODE
from dqreg.cli.lazy_group import Renamed
from dqreg.cli.outputs import as_json_option, consoles, print_json, quiet_option, say
from dqreg.cli.overwriting import require_apart
from dqreg.cli.registration_options import units_option
from dqreg.cli.values import FILE
from dqreg.errors import InputError, printable

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.compare import ComparisonProgress
    from dqreg.compare.engines.registry import EngineSpec
    from dqreg.report.work_bar import WorkBar

# A pipe has no width of its own; the tables need more than the usual 80.
PIPE_WIDTH = 200
OF_TRUST = ("kinds", "seeds", "first_seed", "workers", "fit_confidence")
NOT_OF_TRUST = ("engines", "files", "start", "truth", "source_units", "target_units", "timeout", "plots")


@click.command()
@click.argument("inputs", nargs=-1, type=FILE, metavar="CASE... | SCAN TARGET")
@click.option("--sweep", metavar="standard|quick|trust|FILE", help="Vary initial pose, noise, outliers, overlap and "
              "size on virtual scans, as a TOML file says; trust: how often dqreg's verdict is right.")  # fmt: skip
@click.option("--kinds", multiple=True, metavar="NAME,...", help="With --sweep trust: only these kinds or groups of "
              "task; 'list' lists them.")  # fmt: skip
@click.option(
    "--seeds", type=click.IntRange(min=1), metavar="N", help="With --sweep trust: tasks of each kind  [default: 10]."
)
@click.option("--first-seed", type=click.IntRange(min=0), metavar="N", help="With --sweep trust: seed of the first.")
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="With --sweep trust: processes  [default: 2].")
@click.option("--multiway", is_flag=True, help="The inputs are many scans of one object; --truth holds the true pose "
              "of each.")  # fmt: skip
@click.option("--fit-confidence", is_flag=True, help="With --sweep trust: fit the coefficients of "
              "`verdict.confidence` to its tasks and print them.")  # fmt: skip
@click.option(
    "--engine",
    "-e",
    "engines",
    multiple=True,
    metavar="NAME",
    help="Only this engine; may be repeated  [default: all].",
)
@click.option("--engine-file", "files", multiple=True, type=FILE, help="Python file with your own engine; may be "
              "repeated.")  # fmt: skip
@click.option("--setting", type=click.Choice(["manual", "same-loop", "both"]), default="both", show_default=True,
              help="manual: raw data, each engine as its manual recommends; same-loop: the same points, maximum "
              "distance and iteration limit for all.")  # fmt: skip
@click.option("--start", metavar="none|identity|FILE", help="Initial pose  [default: that of the case; identity for "
              "SCAN TARGET].")  # fmt: skip
@click.option("--truth", type=FILE, help="True pose of SCAN TARGET: truth.json, result.json or 4x4 text.")
@units_option("source", "SCAN, where its file does not say")
@units_option("target", "TARGET, where its file does not say")
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    metavar="N",
    default=3,
    show_default=True,
    help="Timed runs after a warm-up.",
)
@click.option(
    "--threads", type=click.IntRange(min=1), metavar="N", default=2, show_default=True, help="Threads of every engine."
)
@click.option("--timeout", type=float, metavar="SECONDS", help="Time limit for each run  [default: 300, or that of the "
              "sweep].")  # fmt: skip
@click.option("--success", "--home", "success", cls=Renamed, type=float, metavar="FRACTION", default=0.01,
              show_default=True, help="A run succeeds if no point of the part is displaced by more than this fraction "
              "of the part's diagonal.")  # fmt: skip
@click.option("--out", type=FILE, help="JSON with every run; the same command resumes where it stopped  "
              "[default for sweeps: dqreg-compare-NAME.json].")  # fmt: skip
@click.option("--report", type=FILE, help="One page, HTML or PDF, with tables and plots.")
@click.option("--markdown", type=FILE, help="Tables as Markdown.")
@click.option("--csv", type=FILE, help="Summary at full precision.")
@click.option("--plots", type=FILE, help="Folder for the plots as PNG, SVG and PDF.")
@click.option("--list", "show", is_flag=True, help="List the engines and exit.")
@as_json_option
@quiet_option
def compare(inputs: tuple[Path, ...], show: bool, as_json: bool, quiet: bool, **options: Any) -> int:
    """Run every engine, dqreg's and its peers', on the same tasks: success rate, pose error, time and memory.

    \b
    dqreg compare my_case --report report.html           a case: scan.ply, part.stl and truth.json
    dqreg compare recipe.toml other_case                 a recipe is made into a case first
    dqreg compare scan.ply part.stl --start nominal.txt --truth truth.txt
    dqreg compare --sweep standard --report report.html  convergence basin, accuracy, speed: takes long, resumable
    dqreg compare my_case --engine-file my_engine.py     your own method against all others
    dqreg compare scans/*.ply --multiway --truth poses.txt   many scans in one frame, ours and Open3D's
    dqreg compare --sweep trust --report trust.html      false and missed acceptances, kind by kind

    Exit codes: 0 compared, whoever wins; 2 bad input; 130 stopped: the same command resumes.
    """
    console, shown = consoles(quiet=quiet, as_json=as_json, width=PIPE_WIDTH)
    if show:
        from dqreg.compare.engines.registry import engine_specs

        _list(console, engine_specs(_engines(options)), as_json=as_json)
        return 0
    if options.pop("multiway"):
        from dqreg.cli.many_compare import run_many

        return run_many(console, shown, inputs, options, as_json=as_json)
    if options["sweep"] == "trust":
        return _trust(console, shown, inputs, options, as_json=as_json)
    _refuse(options, OF_TRUST, "goes with --sweep trust")
    return _run(console, shown, inputs, options, as_json=as_json)


def _refuse(options: dict[str, Any], names: Sequence[str], why: str) -> None:
    """Raise where an option was given that the sweep at hand does not have."""
    for name in names:
        if options[name]:
            raise InputError(f"--{name.replace('_', '-')} {why}")


def _trust(
    console: Console, shown: Console, inputs: tuple[Path, ...], options: dict[str, Any], *, as_json: bool
) -> int:
    from dqreg.cli.trust_sweep import list_kinds, run_trust_sweep

    if inputs:
        raise InputError(f"--sweep trust makes its own tasks; it takes no {inputs[0]}")
    refused = {"engines": "engine", "files": "engine_file"}
    given = {refused.get(name, name): options[name] for name in NOT_OF_TRUST}
    _refuse(given, tuple(given), "does not go with --sweep trust")
    if options["kinds"] == ("list",):
        list_kinds(console)
        return 0
    done = run_trust_sweep(console, shown, options, _command(), as_json=as_json)
    return STOPPED_CODE if done is None else done


def _run(console: Console, shown: Console, inputs: tuple[Path, ...], options: dict[str, Any], *, as_json: bool) -> int:
    from dqreg.compare import Protocol
    from dqreg.compare import compare as run
    from dqreg.compare.output import Goals, to_json, write
    from dqreg.compare.tables import footer, tables
    from dqreg.report.table import print_tables
    from dqreg.report.work_bar import WorkBar

    sweep = options["sweep"]
    if options["out"] is None and sweep is not None:
        options["out"] = Path(f"dqreg-compare-{Path(sweep).stem}.json")
    goals = Goals(**{name: options[name] for name in ("out", "report", "markdown", "csv", "plots")})
    read = (*inputs, *options["files"], *(Path(options[name]) for name in ("truth", "sweep") if options[name]))
    require_apart(read, {f"--{name}": getattr(goals, name) for name in ("out", "report", "markdown", "csv")})
    settings: Any = ("manual", "same-loop") if options["setting"] == "both" else (options["setting"],)
    protocol = Protocol(
        settings=settings,
        repeats=options["repeats"],
        threads=options["threads"],
        timeout=options["timeout"] or 300.0,
        success_threshold=options["success"],
        withhold_initial_pose=options["start"] == "none",
    )
    tasks, protocol = _tasks(inputs, options, protocol)
    if not tasks:
        raise InputError("give a case, a recipe, SCAN TARGET or --sweep; see dqreg compare --help")
    goals.check()
    try:
        with WorkBar(shown, counted=False) as bar:
            found = run(tasks, _engines(options), protocol=protocol, out=goals.lines, observe=_told(bar, shown))
    except KeyboardInterrupt:
        there = goals.lines is not None and goals.lines.exists()
        kept = f"; the runs so far are in {goals.lines}: the same command resumes from there" if there else ""
        click.echo(f"dqreg: stopped by the user{printable(kept)}", err=True)
        return STOPPED_CODE
    made, note = tables(found), footer(found, protocol.success_threshold)
    print_tables(console, made)
    console.print()
    console.print(note, style="dim", markup=False, soft_wrap=True)
    for path in write(found, made, goals, note, _command()):
        say(console, f"wrote {path}")
    if as_json:
        click.echo(to_json(found), nl=False)
    return 0


def _tasks(inputs: tuple[Path, ...], options: dict[str, Any], protocol: Any) -> tuple[list[Any], Any]:
    """What to compare on, and the protocol with the sweep's time limit."""
    import dataclasses

    from dqreg.compare import read_sweep

    tasks: list[Any] = []
    if options["sweep"] is not None:
        sweep = read_sweep(options["sweep"])
        tasks.append(sweep)
        protocol = dataclasses.replace(protocol, timeout=options["timeout"] or sweep.timeout)
    pair = len(inputs) == 2 and not any(path.is_dir() or path.suffix.lower() == ".toml" for path in inputs)
    if pair:
        return [*tasks, *_pair(inputs, options, protocol)], protocol
    for name in ("truth", "source_units", "target_units"):
        if options[name] is not None:
            raise InputError(f"--{name.replace('_', '-')} goes with SCAN TARGET; a case says it in its truth.json")
    if options["start"] not in (None, "none"):
        raise InputError("--start goes with SCAN TARGET; a case brings its own start, or --start none withholds it")
    return [*tasks, *inputs], protocol


def _pair(inputs: tuple[Path, ...], options: dict[str, Any], protocol: Any) -> list[Any]:
    from dqreg.compare import from_pair, read_truth
    from dqreg.files.poses import read_start

    start = read_start(options["start"] or "identity")
    truth = None if options["truth"] is None else read_truth(options["truth"])
    settings = ["manual"] if start is None and "manual" in protocol.settings else protocol.settings
    scan, target = inputs
    return [
        from_pair(
            scan,
            target,
            start,
            truth,
            source_units=options["source_units"],
            target_units=options["target_units"],
            setting=setting,
            threads=protocol.threads,
            success_threshold=protocol.success_threshold,
        )
        for setting in settings
    ]


def _engines(options: dict[str, Any]) -> list[Any] | None:
    """Who takes part; None leaves it to the sweep or the registry."""
    named, files = list(options["engines"]), list(options["files"])
    if named or not files:
        return [*named, *files] or None
    from dqreg.compare import read_sweep
    from dqreg.compare.engines.registry import ENGINES, engine_specs

    own = read_sweep(options["sweep"]).engines if options["sweep"] is not None else ()
    # A sweep may name those of the files, too.
    held = {spec.name for spec in engine_specs(files)}
    return [*(name for name in own or ENGINES if name not in held), *files]


def _list(console: Console, found: Sequence[EngineSpec], *, as_json: bool) -> None:
    from dqreg.compare.engines.registry import missing

    if as_json:
        print_json([
            {
                "engine": spec.name,
                "without_initial_pose": not spec.needs_initial_pose,
                "settings": spec.settings,
                "missing": missing(spec),
            }
            for spec in found
        ])  # fmt: skip
    for spec in found:
        state = f"missing: pip install {' '.join(missing(spec))}" if missing(spec) else "ready"
        start = "needs a start" if spec.needs_initial_pose else "with or without start"
        line = f"{spec.name:<34} {start:<22} {', '.join(spec.settings):<20} {state}"
        say(console, line)


def _told(bar: WorkBar, console: Console) -> Callable[[ComparisonProgress], None]:
    """Shows where a comparison is."""
    from dqreg.compare.tables import number

    def tell(progress: ComparisonProgress) -> None:
        run, line = progress.run, ""
        if run is not None:
            found = f"{number(run.worst / run.size)} S, {number(run.seconds)} s"
            result = found if run.status == "ran" else run.message
            mark = {True: "found", False: "not found", None: "done"}[run.success]
            line = f"{100 * progress.done / progress.total:3.0f} %  {progress.words}: {mark}, {result}"
        drawn = bar.show(progress.done, progress.total, progress.seconds_left, progress.words)
        if line and not drawn:
            say(console, line)

    return tell


def _command() -> str:
    """The command line as it was given, where it was one."""
    return shlex.join(["dqreg", *sys.argv[1:]]) if sys.argv[1:2] == ["compare"] else ""
