"""The engines that `dqreg odometry` runs over a sequence, each with its progress, and what goes along with ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.cli.outputs import say
from dqreg.errors import InputError, MissingDependencyError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg._arrays import FloatArray
    from dqreg.odometry.live import LiveMap
    from dqreg.odometry.motion import MotionPrior
    from dqreg.odometry.run_sequence import TrajectoryRun
    from dqreg.odometry.scans import Scans
    from dqreg.odometry.settings import OdometrySettings


def run_one(
    console: Console,
    engine: str,
    scans: Scans,
    settings: OdometrySettings,
    show: Callable[..., object] | None = None,
    motion: MotionPrior | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> TrajectoryRun:
    """The engine that was asked for, until it is to stop."""
    from dqreg.odometry.peers import KissEngine, run_engine
    from dqreg.odometry.run_sequence import run_sequence
    from dqreg.report.work_bar import WorkBar

    with WorkBar(console) as bar:
        step = bar.steps(len(scans), engine)
        if engine == "dq":
            return run_sequence(scans, settings, step, show, motion, stop)
        kiss = KissEngine(settings.max_range or 100.0, settings.voxel_size, settings.deskew, settings.min_range)
        return run_engine("KISS-ICP", kiss, scans, step)


def run_others(
    console: Console, scans: Scans, settings: OdometrySettings, stop: Callable[[], bool]
) -> list[TrajectoryRun]:
    """The engines to compare with; without the one that is stopped and those after it."""
    from dqreg.odometry.peers import peers, run_engine
    from dqreg.report.work_bar import WorkBar

    trips: list[TrajectoryRun] = []
    for name, make in [] if stop() else peers(settings, _first_points(scans)):
        try:
            engine = make()
        except MissingDependencyError as error:
            say(console, f"{name}: not run: {error}")
            continue
        with WorkBar(console) as bar:
            trip = run_engine(name, engine, scans, bar.steps(len(scans), name), stop)
        if len(trip.poses) < len(scans):
            break
        trips.append(trip)
    return trips


def _first_points(scans: Scans) -> FloatArray:
    """Points of the first frame that holds any."""
    from dqreg.odometry.frame import read_frame

    for number in range(len(scans)):
        if len(points := read_frame(scans[number].points, None).points):
            return points
    raise InputError("no frame holds a finite point; a comparison needs one to measure the voxel")


def live_view(console: Console, options: dict[str, Any]) -> LiveMap | None:
    """The page that shows the run, open before it begins."""
    if not options["view"]:
        return None
    from dqreg.odometry.live import LiveMap
    from dqreg.report.live_server import where

    view = LiveMap(options["port"])
    say(console, where(view.server))
    return view


def motion_prior(console: Console, path: Path, scans: Scans, options: dict[str, Any]) -> MotionPrior | None:
    """The motion that another topic of the bag tells."""
    if options["motion"] is None:
        return None
    from dqreg.odometry.motion_topics import open_motion

    prior = open_motion(path, options["motion"], scans, options["topic"])
    say(console, prior.words)
    return prior
