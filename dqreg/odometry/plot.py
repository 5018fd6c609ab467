"""Pictures of a run: the path from above, and each frame's trust and error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.odometry.evaluation import relative_errors
from dqreg.odometry.run_sequence import TrajectoryRun
from dqreg.odometry.trajectory import bridge_gaps
from dqreg.report.figure import PALETTE, encode, new_figure

BLUE, RED = PALETTE[0], PALETTE[1]
ORANGE, GREY = PALETTE[4], PALETTE[6]


def plot_trip(path: str | Path, trip: TrajectoryRun, truth: FloatArray | None = None) -> None:
    """Draw the path, and below it each frame's share on the map, one-sigma and error. Shapes: truth (n, 4, 4)."""
    kind = plot_kind(path)
    poses, _ = bridge_gaps(trip.poses)
    figure = new_figure(9.0, 9.0, 120)
    grid = figure.add_gridspec(3, 1, height_ratios=[2.2, 1.0, 1.0])
    _draw_path(figure.add_subplot(grid[0]), poses, trip, truth)
    numbers = figure.add_subplot(grid[1])
    _draw_errors(numbers, poses, truth)
    _draw_trust(figure.add_subplot(grid[2], sharex=numbers), trip)
    write_atomically(path, encode(figure, kind))


def plot_kind(path: str | Path) -> str:
    """Format of a picture by its name; asked before the run too, so that no run ends without it."""
    kind = Path(path).suffix.lower().lstrip(".") or "png"
    if kind not in ("png", "svg", "pdf"):
        raise InputError(f"cannot draw {path}: expected a name that ends in .png, .svg or .pdf")
    return kind


def _plane(places: FloatArray) -> tuple[int, int]:
    # The two widest axes: looking down on a path, whichever axis is up.
    first, second = sorted(np.argsort(np.ptp(places, axis=0), kind="stable")[1:].tolist())
    return first, second


def _draw_path(axes: Any, poses: FloatArray, trip: TrajectoryRun, truth: FloatArray | None) -> None:
    places = poses[:, :3, 3]
    u, v = _plane(places)
    if truth is not None:
        true = (poses[0] @ np.linalg.inv(truth[0]) @ truth)[:, :3, 3]
        axes.plot(true[:, u], true[:, v], color=GREY, linewidth=3.0, alpha=0.5, label="truth")
    axes.plot(places[:, u], places[:, v], color=BLUE, marker=".", linewidth=1.2, label=trip.name)
    bad = [i for i, result in enumerate(trip.results) if result.verdict.level != "accepted"]
    if bad:
        axes.scatter(places[bad, u], places[bad, v], color=RED, marker="x", zorder=3, label="not accepted")
    axes.plot(*places[0, [u, v]], color="black", marker="s", linestyle="none", label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("xyz"[u])
    axes.set_ylabel("xyz"[v])
    axes.set_title(f"{len(poses)} frames")
    axes.legend(loc="best", frameon=False)


def _draw_errors(axes: Any, poses: FloatArray, truth: FloatArray | None) -> None:
    frames = np.arange(1, len(poses))
    if truth is not None and len(poses) > 1:
        turn, shift = relative_errors(poses, truth, 1)
        axes.semilogy(
            frames, np.maximum(shift, 1e-12), color=ORANGE, marker=".", linewidth=0.8, label="translation error"
        )
        axes.semilogy(
            frames, np.maximum(turn, 1e-12), color=BLUE, marker=".", linewidth=0.8, label="rotation error [deg]"
        )
        axes.set_ylabel("step against truth")
    else:
        steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        axes.plot(frames, steps, color=BLUE, marker=".", linewidth=0.8, label="length of the step")
        axes.set_ylabel("step")
    # Above: the curves fill what is below.
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0, frameon=False)
    axes.grid(alpha=0.3)


def _draw_trust(axes: Any, trip: TrajectoryRun) -> None:
    axes.set_xlabel("frame")
    if not trip.results:
        axes.plot(np.arange(len(trip.seconds)), trip.seconds, color=GREY, linewidth=0.8)
        axes.set_ylabel("seconds")
        return
    sigma = np.array([np.sqrt(np.trace(result.covariance[3:, 3:])) for result in trip.results])
    axes.plot(np.where(sigma > 0.0, sigma, np.nan), color=ORANGE, marker=".", linewidth=0.8)
    axes.set_ylabel("one sigma of the translation", color=ORANGE)
    axes.grid(alpha=0.3)
    share = axes.twinx()
    share.plot([result.inlier_fraction for result in trip.results], color=BLUE, linewidth=1.0)
    share.set_ylim(0.0, 1.0)
    share.set_ylabel("inlier fraction", color=BLUE)
