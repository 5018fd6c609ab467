"""`dqreg multiway SCANS...`: many scans into one frame, with a model, a graph and a report."""

from __future__ import annotations

import contextlib
import glob
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.exit_codes import code_of
from dqreg.cli.lazy_group import Choice
from dqreg.cli.outputs import as_json_option, consoles, print_json, quiet_option, say
from dqreg.cli.overwriting import require_apart, require_ending
from dqreg.cli.registration_options import effort_option, seed_option
from dqreg.cli.values import FILE, NO_PLACE, PLACE, PlaceCommand, PlaceType
from dqreg.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg.multiway import Multiway, Progress
    from dqreg.report.work_bar import WorkBar

# The same words as in the library, which a test compares.
ORDERS = ("any", "sequence", "turntable")
EDGES = ("auto", "chain", "ring")
# Columns of the tables in a pipe.
PIPE_COLUMNS = 120
# Names that show an order.
SHOWN_NAMES = 3
SECTIONS = {
    "Output": ("out", "fused", "report", "graph", "voxel", "as_json"),
    "What is known": ("order", "edges", "target", "starts", "viewpoint", "anchor"),
    "Registration": ("effort", "workers", "time_limit", "resume", "seed"),
}


@click.command("multiway", cls=PlaceCommand, sections=SECTIONS)
@click.argument("scans", nargs=-1, required=True)
@click.option("--out", type=FILE, help="The result as JSON; poses alone for .txt (KITTI; TUM for _tum.txt) or .tum.")
@click.option("--fused", type=FILE, help="One cloud of all placed scans as PLY, with normals "
              "where it is known from which side the scans were taken.")  # fmt: skip
@click.option(
    "--report", type=FILE, help="One page, HTML or PDF: verdict, graph, scans together, loops, what to rescan."
)
@click.option("--graph", type=FILE, help="The pose graph as .g2o, for GTSAM and others.")
@click.option("--voxel", type=float, metavar="LENGTH", help="Cells of --fused  [default: spacing of the points].")
@click.option("--order", type=Choice(ORDERS), default="any", show_default=True, help="What is known of the order: "
              "nothing, a moving scanner, or one turntable step after the other.")  # fmt: skip
@click.option("--edges", type=Choice(EDGES), default="auto", show_default=True, help="Pairs to register: those that "
              "are useful, neighbours, or neighbours and the last with the first.")  # fmt: skip
@click.option("--target", type=FILE, help="A CAD part (or scan) in whose frame all scans are placed.")
@click.option("--starts", type=FILE, help="Initial poses, one a scan: KITTI or TUM, or an earlier result.")
@click.option("--viewpoint", type=PlaceType(), metavar="origin|X Y Z", help="Where the scanner stood, in the frame of "
              "each scan: tells the front of a thin sheet from its back.")  # fmt: skip
@click.option("--anchor", type=int, default=0, show_default=True, metavar="N", help="Scan whose frame is the world, "
              "counted from 0.")  # fmt: skip
@effort_option()
@click.option("--workers", type=int, metavar="N", help="Pairs registered at once  [default: one for each core].")
@click.option("--time-limit", type=float, metavar="SECONDS", help="Time limit for all scans together; returns the best "
              "poses so far, and a verdict that says so.")  # fmt: skip
@click.option("--resume", is_flag=True, help="Take the pairs that an interrupted run with the same --out has finished.")
@seed_option()
@as_json_option
@quiet_option
def multiway_command(scans: tuple[str, ...], quiet: bool, as_json: bool, **options: Any) -> int:
    """Bring many scans of one object or place into one frame: no initial poses needed.

    SCANS are files, or patterns such as 'scans/*.ply', which come as they are numbered: scan2 before scan10.

    \b
    dqreg multiway scans/*.ply --out poses.json --fused model.ply --report report.html
    dqreg multiway scans/*.ply --order turntable --out poses.json --fused model.ply
    dqreg multiway scans/*.ply --target part.stl --out poses.json
    dqreg multiway stops/*.pcd --viewpoint origin --graph graph.g2o --out poses.txt
    dqreg multiway scans/*.ply --out poses.json --resume        after an interruption

    Pairs are kept in a folder beside --out (poses-pairs) as they are finished.

    Exit codes: 0 verdict accepted, 1 ran but not accepted, 2 bad input.
    """
    from dqreg._open3d import load_open3d
    from dqreg.multiway import register_many
    from dqreg.multiway.pairwise.starts import read_starts_file
    from dqreg.report.work_bar import WorkBar

    files = _files(scans)
    _check(files, options)
    console, shown = consoles(quiet=quiet, as_json=as_json, width=PIPE_COLUMNS, apart=True)
    files = _as_numbered(files, options, shown)
    names = ("target", "edges", "order", "anchor", "effort", "seed", "workers", "time_limit")
    # After all that can be refused: it removes the pairs of an earlier run.
    with _pairs_folder(shown, options["out"], resume=options["resume"]) as folder, _kept(folder), WorkBar(shown) as bar:
        load_open3d()
        result = register_many(
            files,
            starts=None if options["starts"] is None else read_starts_file(options["starts"], len(files)),
            viewpoints=options["viewpoint"],
            observe=_told(bar, shown, files),
            folder=folder,
            **{name: options[name] for name in names},
        )
    _show(console, result)
    _write(console, result, options)
    if as_json:
        print_json(result.to_dict())
    return code_of([result.verdict.level])


def _files(scans: tuple[str, ...]) -> list[Path]:
    """Files of names and patterns, in the order given; those of a pattern as they are numbered."""
    from dqreg.files.natural_order import natural_order

    found: list[Path] = []
    for text in scans:
        matched = [text] if Path(text).exists() else sorted(glob.glob(text), key=natural_order)  # noqa: PTH207 - a pattern may begin anywhere
        if not matched:
            raise InputError(f"there is no file {text!r}, and it matches none as a pattern")
        for name in matched:
            if Path(name).is_dir():
                raise InputError(f"{name} is a folder; give the scans in it: '{name}/*.ply'")
            found.append(Path(name))
    return found


def _as_numbered(files: list[Path], options: dict[str, Any], console: Console) -> list[Path]:
    """The files; of scans whose order counts as they are numbered, where a shell listed them 1, 10, 2."""
    from dqreg.files.natural_order import is_shell_order, natural_order

    if options["order"] == "any" or not is_shell_order(files):
        return files
    shown = ", ".join(file.stem for file in files[:SHOWN_NAMES])
    if options["starts"] is not None:
        say(
            console,
            f"scans are taken in the order given, as --starts: {shown}, ... Is that --order {options['order']}?",
        )
        return files
    found = sorted(files, key=natural_order)
    numbered = ", ".join(file.stem for file in found[:SHOWN_NAMES])
    say(console, f"scans are taken as they are numbered: {numbered}, ... (the shell gave {shown}, ...)")
    return found


@contextlib.contextmanager
def _pairs_folder(console: Console, out: Path | None, *, resume: bool) -> Iterator[Path | None]:
    """The folder of finished pairs, held against other runs; without --resume, those of an earlier run are removed."""
    from dqreg.files.atomic import is_stream
    from dqreg.files.folder_lock import held_folder
    from dqreg.multiway.scans.kept_pairs import pairs_in

    if out is None or is_stream(out):
        if resume:
            raise InputError("--resume needs --out and the name of a file: the finished pairs are kept beside it")
        yield None
        return
    folder = out.with_name(f"{out.stem}-pairs")
    with held_folder(folder, "dqreg multiway"):
        old = [] if resume else list(pairs_in(folder))
        for path in old:
            path.unlink(missing_ok=True)
        if old:
            pairs = "1 finished pair" if len(old) == 1 else f"{len(old)} finished pairs"
            say(console, f"removed {pairs} of an earlier run from {folder}; --resume would have taken them")
        yield folder


@contextlib.contextmanager
def _kept(folder: Path | None) -> Iterator[None]:
    """Whoever ends the run early is told what is kept of it."""
    from dqreg.cli.signals import write
    from dqreg.multiway.scans.kept_pairs import pairs_in

    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        count = 0 if folder is None else len(list(pairs_in(folder)))
        if count:
            write(
                f"{count} finished {'pair is' if count == 1 else 'pairs are'} kept in {folder}: --resume goes on there"
            )
        raise


def _check(files: list[Path], options: dict[str, Any]) -> None:
    from dqreg.files.atomic import require_writable
    from dqreg.files.write import require_cloud_suffix
    from dqreg.report.page_file import page_path

    names = ("out", "fused", "report", "graph")
    require_apart((*files, options["target"]), {f"--{name}": options[name] for name in names})
    words = "the result as JSON, or poses alone"
    require_ending("--out", options["out"], words, (".json", ".txt", ".tum", ".kitti", ".g2o"))
    for name in names:
        if options[name] is not None:
            (page_path if name == "report" else require_writable)(options[name])
    if options["fused"] is not None:
        require_cloud_suffix(options["fused"])
    if options["graph"] is not None and options["graph"].suffix.lower() != ".g2o":
        raise InputError(f"--graph writes g2o; give a name that ends in .g2o, not {options['graph'].name!r}")
    if options["viewpoint"] == NO_PLACE:
        raise InputError(f"many scans need the places that their files tell: {PLACE} takes another one, not {NO_PLACE}")
    if options["voxel"] is not None and not options["voxel"] >= 0.0:
        raise InputError(f"--voxel must be a length, 0 or more; got {options['voxel']!r}")


def _told(bar: WorkBar, console: Console, files: list[Path]) -> Callable[[Progress], None]:
    """Shows how far the pairs are."""
    from dqreg.report.progress import left_words

    def tell(progress: Progress) -> None:
        edge = progress.edge
        together = len(edge.registration.settings.get("against", ()))
        one = "part" if edge.target < 0 else files[edge.target].stem
        first = f"{together} scans together" if together else one
        words = f"{first} - {files[edge.source].stem}: {edge.level}"
        if not bar.show(progress.done, progress.total, progress.seconds_left, words):
            rest = left_words(progress.seconds_left) if progress.done < progress.total else ""
            say(console, ", ".join(filter(None, (f"{progress.done}/{progress.total}  {words}", rest))))

    return tell


def _show(console: Console, result: Multiway) -> None:
    from dqreg.multiway.report.tables import scans_table
    from dqreg.report.table import print_tables

    print_tables(console, [scans_table(result)])
    say(console, "")
    say(console, f"verdict: {result.verdict.level.upper()}")
    for reason in result.verdict.reasons:
        say(console, f"  {reason}")


def _write(console: Console, result: Multiway, options: dict[str, Any]) -> None:
    from dqreg.files import write_cloud

    joined = result.verdict.level != "failed"
    for name in ("out", "graph"):
        path = options[name]
        if path is not None and name == "graph" and not joined:
            say(console, f"not written: {path} (no two scans were joined)")
        elif path is not None:
            result.save(path)
            say(console, f"wrote {path}")
    if options["fused"] is not None and not joined:
        say(console, f"not written: {options['fused']} (no two scans were joined)")
    elif options["fused"] is not None:
        cloud, left_out = result._merged(options["voxel"])
        write_cloud(options["fused"], cloud.points, cloud.normals)
        bare = "" if cloud.normals is not None else "; no normals: nothing tells the outside. --viewpoint does"
        say(console, f"wrote {options['fused']} ({len(cloud)} points{bare})")
        if left_out:
            points = "1 point" if left_out == 1 else f"{left_out} points"
            say(console, f"  left out of it: {points} that other scans looked through")
    if options["report"] is not None:
        with console.status("writing the report"):
            result.report(options["report"])
        say(console, f"wrote {options['report']}")
