"""`dqreg odometry SCANS`: a LiDAR sequence to a trajectory, with a verdict for every frame."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.exit_codes import SIGNAL_CODE, code_of
from dqreg.cli.lazy_group import Renamed
from dqreg.cli.outputs import as_json_option, consoles, port_option, print_json, quiet_option, say
from dqreg.cli.overwriting import require_apart, require_ending
from dqreg.cli.signals import PoliteSignals, write
from dqreg.cli.values import FILE
from dqreg.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg._arrays import FloatArray
    from dqreg.odometry.run_sequence import TrajectoryRun
    from dqreg.odometry.scans import Scans

# Frames that are named one by one on the screen; all of them are in --frames.
NAMED_FRAMES = 20
# Columns of the table in a pipe.
PIPE_COLUMNS = 120
# What no engine but ours has; KISS-ICP gets the lengths and the motion compensation.
OURS = {
    "view": "shows our engine",
    "motion": "guides our engine",
    "method": "is the estimator of our engine",
    "search_deg": "is the search of our engine",
    "map_search": "is the search of our engine",
    "time_limit": "limits the search of our engine",
}


@click.command("odometry")
@click.argument("scans", type=FILE)
@click.option(
    "--out", type=FILE, help="Write the trajectory (KITTI; TUM for names ending in .tum or _tum.txt, g2o for .g2o)."
)
@click.option(
    "--format", "form", type=click.Choice(["kitti", "tum", "g2o"]), help="Format of --out, whatever its name."
)
@click.option("--engine", type=click.Choice(["dq", "kiss-icp"]), default="dq", show_default=True,
              help="Odometry engine.")  # fmt: skip
@click.option("--truth", type=FILE, help="True trajectory (KITTI, TUM, truth.json), to print the errors.")
@click.option("--compare", is_flag=True, help="Then run KISS-ICP, GenZ-ICP and small_gicp on them: one table.")
@click.option("--frames", type=FILE, help="Write a CSV: verdict, standard deviations and reasons of every frame.")
@click.option("--plot", type=FILE, help="Plot the path, the errors and the uncertainty (.png, .svg, .pdf).")
@click.option("--times", type=FILE, help="Timestamps, one line for each frame  [default: times.txt beside the scans].")
@click.option("--topic", metavar="NAME", help="Topic of the clouds in a bag that has several.")
@click.option("--motion", metavar="NAME", help="Topic of the bag that predicts the motion: wheels (Odometry) or a "
              "gyroscope (Imu).")  # fmt: skip
@click.option("--loader", metavar="NAME", help="One of KISS-ICP's data loaders: kitti, mulran, ncd, ...")
@click.option("--sequence", metavar="NAME", help="Sequence for the loader.")
@click.option("--first", type=int, metavar="N", help="Run the first N frames only.")
@click.option("--voxel-size", type=float, metavar="LENGTH", help="Voxel size of the map  [default: 0.05 of the "
              "median range].")  # fmt: skip
@click.option(
    "--max-range", type=float, metavar="LENGTH", help="Maximum range of points  [default: twice the farthest of the "
    "first frame]."
)  # fmt: skip
@click.option("--min-range", type=float, metavar="LENGTH", default=0.0, show_default=True, help="Minimum range of "
              "points.")  # fmt: skip
@click.option("--no-deskew", "deskew", flag_value=False, default=True, help="No motion compensation within a sweep.")
@click.option("--search-deg", "--search", "search_deg", cls=Renamed, type=float, metavar="DEGREES", default=60.0,
              show_default=True, help="Largest rotation between two frames that is searched.")  # fmt: skip
@click.option("--map-search", type=click.Choice(["never", "doubt"]), default="doubt", show_default=True,
              help="Search in all of the map for a frame that is lost or in doubt where it is expected.")  # fmt: skip
@click.option("--time-limit", type=float, metavar="SECONDS", help="Time limit of such a search, for one frame.")
@click.option("--method", metavar="plane|dq|dq-points", default="plane", show_default=True, help="Estimator.")
@click.option("--view", is_flag=True, help="Show map, frame and trajectory in the browser while it runs, on this "
              "machine alone, until Ctrl-C. Works over ssh.")  # fmt: skip
@port_option
@as_json_option
@quiet_option
def odometry_command(scans: Path, **options: Any) -> int:
    """Estimate the trajectory of a LiDAR sequence, with a verdict for every frame.

    SCANS is a bag of ROS 1 or ROS 2 (.bag, .mcap, .db3 or its folder), a folder of PLY, PCD, LAS, BIN (KITTI) or NPZ
    files, or one .npz with points and offsets.

    \b
    dqreg odometry my_scans --out poses.txt
    dqreg odometry my_scans --truth truth.txt --plot run.png --frames frames.csv
    dqreg odometry my.bag --topic /points --motion /odom --out poses.tum
    dqreg odometry my_scans --truth truth.txt --compare
    dqreg odometry my_scans --view
    dqreg odometry my_scans --json | jq '.frames[] | select(.level != "accepted")'
    dqreg odometry kitti/ --loader kitti --sequence 07 --out poses_07.txt

    Ctrl-C keeps the frames (with --compare, the engines) that are done and writes what was asked for of them; a second
    one stops at once.

    Exit codes: 0 every frame accepted, 1 some were not (they are named), 2 bad input, 130 or 143 stopped by a signal.
    """
    from dqreg.cli.odometry_engines import live_view, motion_prior, run_one, run_others
    from dqreg.odometry.scans import open_scans
    from dqreg.odometry.settings import OdometrySettings

    _refuse_contradictions(options)
    names = ("voxel_size", "max_range", "min_range", "deskew", "search_deg", "method", "map_search", "time_limit")
    settings = OdometrySettings(**{name: options[name] for name in names})
    _require_goals(scans, options)
    # A table squeezed into a pipe's 80 columns cannot be read.
    console, shown = consoles(quiet=options["quiet"], as_json=options["as_json"], width=PIPE_COLUMNS)
    data = _first(
        open_scans(scans, options["times"], options["loader"], options["sequence"], options["topic"]), options["first"]
    )
    _require_several(data)
    truth = _truth(options["truth"], data)
    motion = motion_prior(console, scans, data, options)
    view = live_view(console, options)
    show = None if view is None else view.show
    with PoliteSignals() as asked:
        # Another engine's frames are not kept.
        asked.polite = options["engine"] == "dq"
        main = run_one(shown, options["engine"], data, settings, show, motion, asked.asked)
        # The answer is ours, so the others come after it: they may take longer, and be stopped.
        others = run_others(shown, data, settings, asked.asked) if options["compare"] else []
    if asked.number:
        done = len(main.poses)
        write(f"stopped after {done} of {len(data)} frames; the answer is of these" if done < len(data)
              else "stopped in the comparison; the table is of the engines that were done")  # fmt: skip
        if not done:
            return SIGNAL_CODE + asked.number
        data, truth = _first(data, done), None if truth is None else truth[:done]
    _show(console, [*others, main], truth)
    _write(console, main, data, truth, options)
    if options["as_json"]:
        from dqreg.odometry.frame_table import to_records

        print_json({"engine": main.name, "frames": to_records(main, data)})
    if asked.number:
        return SIGNAL_CODE + asked.number
    if view is not None:
        from dqreg.report.live_server import wait

        wait(view.server)
    return code_of(result.verdict.level for result in main.results)


def _require_goals(scans: Path, options: dict[str, Any]) -> None:
    """Refuse, before the work, what cannot be written."""
    from dqreg.files.atomic import require_writable

    if options["plot"] is not None:
        from dqreg.odometry.plot import plot_kind

        plot_kind(options["plot"])
    goals = {f"--{name}": options[name] for name in ("out", "frames", "plot")}
    require_apart((scans, options["times"], scans / "times.txt", options["truth"]), goals)
    require_ending("--frames", goals["--frames"], "a table of comma-separated values", (".csv", ".txt"))
    for goal in filter(None, goals.values()):
        require_writable(goal)


def _refuse_contradictions(options: dict[str, Any]) -> None:
    """Raise where an option was given that the engine does not have; a default is no wish."""
    from click.core import ParameterSource

    engine, context = options["engine"], click.get_current_context()
    if engine == "dq":
        return
    if options["compare"]:
        raise InputError(f"--compare runs all engines and writes what ours found: leave --engine {engine} out")
    for option in context.command.params:
        if option.name in OURS and context.get_parameter_source(option.name) is not ParameterSource.DEFAULT:
            words = f"{option.opts[0]} {OURS[option.name]}"
            raise InputError(f"{words}, and --engine {engine} was asked for: leave one out")


def _first(scans: Scans, count: int | None) -> Scans:
    import dataclasses

    if count is None:
        return scans
    if count < 1:
        raise InputError(f"--first must be at least 1; got {count}")
    times, truth = (None if values is None else values[:count] for values in (scans.times, scans.truth))
    return dataclasses.replace(scans, names=scans.names[:count], times=times, truth=truth)


def _require_several(scans: Scans) -> None:
    """Refuse one frame: the first one is accepted for what it is, the frame of the map."""
    if len(scans) < 2:
        raise InputError(
            f"the only frame, {scans.names[0]}, places nothing: it defines the frame of the map; odometry needs two or "
            "more, and dqreg register places one scan on a part or on another scan"
        )


def _truth(file: Path | None, scans: Scans) -> FloatArray | None:
    import numpy as np

    from dqreg.multiway.pairwise.starts import read_result_poses
    from dqreg.odometry.scores import match_truth
    from dqreg.odometry.trajectory import read_trajectory

    if file is None:
        return scans.truth
    # The truth of a virtual case, and results of dqreg multiway.
    is_record = file.suffix.lower() == ".json"
    poses, times = (np.array(read_result_poses(file)), None) if is_record else read_trajectory(file, gaps="keep")
    if not np.isfinite(poses).all():
        raise InputError(f"{file} holds scans without a pose; the truth has one for each frame")
    if times is None and len(poses) > len(scans):
        poses = poses[: len(scans)]
    return match_truth(poses, times, scans.times, len(scans))


def _show(console: Console, trips: list[TrajectoryRun], truth: FloatArray | None) -> None:
    from dqreg.odometry.scores import results_table, search_words, trust_words
    from dqreg.report.table import print_tables

    print_tables(console, [results_table(trips, truth)])
    results = trips[-1].results
    if not results:
        return
    if truth is not None:
        say(console, trust_words(trips[-1], truth))
    levels = [result.verdict.level for result in results]
    say(console, ", ".join(f"{levels.count(level)} {level}" for level in ("accepted", "suspect", "failed")))
    bad = [(number, result) for number, result in enumerate(results) if result.verdict.level != "accepted"]
    for number, result in bad[:NAMED_FRAMES]:
        say(console, f"  frame {number}: {result.verdict.level.upper()}: {'; '.join(result.verdict.reasons)}")
    if len(bad) > NAMED_FRAMES:
        say(console, f"  and {len(bad) - NAMED_FRAMES} more: see --frames FILE")
    if searches := search_words(trips[-1]):
        say(console, searches)


def _write(
    console: Console, trip: TrajectoryRun, scans: Scans, truth: FloatArray | None, options: dict[str, Any]
) -> None:
    from dqreg.odometry.frame_table import write_frames
    from dqreg.odometry.plot import plot_trip
    from dqreg.odometry.trajectory import bridge_gaps, write_trajectory

    if options["out"] is not None:
        poses = trip.poses if scans.calibrate is None else scans.calibrate(trip.poses)
        spread = [result.covariance for result in trip.results] or None
        form = write_trajectory(options["out"], poses, scans.times, options["form"], covariances=spread)
        missing = bridge_gaps(trip.poses)[1].tolist()
        done = "bridged" if form == "kitti" else "left out"
        gaps = f"; frames without a pose are {done}: {', '.join(map(str, missing))}" if missing else ""
        say(console, f"wrote {options['out']} ({form.upper()}{gaps})")
    if options["frames"] is not None:
        write_frames(options["frames"], trip, scans)
        say(console, f"wrote {options['frames']}")
    if options["plot"] is not None:
        plot_trip(options["plot"], trip, truth)
        say(console, f"wrote {options['plot']}")
