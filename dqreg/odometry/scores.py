"""Trajectories of engines against the truth: one engine a row, words and numbers ready to be shown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.odometry.evaluation import CHI2_HIGH, evaluate, nees
from dqreg.odometry.run_sequence import TrajectoryRun
from dqreg.report.table import Column, Table

# Median / worst error of the motions over one and ten frames; frames lost; the path's error.
COLUMNS = (
    Column("engine", align="left"),
    Column("1 frame:\nrotation", "deg", align="right"),
    Column("1 frame:\ntranslation", align="right"),
    Column("10 frames:\nrotation", "deg", align="right"),
    Column("10 frames:\ntranslation", align="right"),
    Column("lost", align="right"),
    Column("path rms", align="right"),
    Column("frames\na second", align="right"),
)
# Those that need no truth.
KNOWN = ("engine", "lost", "frames\na second")


def results_table(trips: Sequence[TrajectoryRun], truth: FloatArray | None) -> Table:
    """One engine a row. Shapes: truth (n, 4, 4)."""
    rows = [_row(trip, truth) for trip in trips]
    if truth is None:
        # Without a truth no error is known.
        known = tuple(k for k, column in enumerate(COLUMNS) if column.name in KNOWN)
        return Table(
            "odometry", "", tuple(COLUMNS[k] for k in known), tuple(tuple(row[k] for k in known) for row in rows)
        )
    title = "errors of the motion over one and over ten frames: median / worst; lengths in the scans' unit"
    return Table("odometry", title, COLUMNS, tuple(rows))


def match_truth(truth: FloatArray, truth_times: FloatArray | None, times: FloatArray | None, count: int) -> FloatArray:
    """True pose of each frame. Shapes: truth (m, 4, 4), returns (count, 4, 4)."""
    if len(truth) == count:
        return truth
    if truth_times is None or times is None:
        raise InputError(
            f"the truth has {len(truth)} poses for {count} frames; one a frame is needed, or times in both"
        )
    nearest = np.abs(truth_times[None, :] - times[:, None]).argmin(axis=1)
    gap = np.abs(truth_times[nearest] - times).max()
    spacing = float(np.median(np.diff(np.sort(times)))) if count > 1 else np.inf
    if not gap <= 0.1 * spacing:
        raise InputError(f"a frame is {gap:.3g} s away from the nearest true pose; frames are {spacing:.3g} s apart")
    matched: FloatArray = truth[nearest]
    return matched


def _row(trip: TrajectoryRun, truth: FloatArray | None) -> tuple[str, ...]:
    speed = f"{len(trip.seconds) / max(float(trip.seconds.sum()), 1e-9):.1f}"
    missing = int(np.count_nonzero(~np.isfinite(trip.poses).all(axis=(1, 2))))
    if truth is None or missing == len(trip.poses):
        return (trip.name, "", "", "", "", str(missing), "", speed)
    errors = evaluate(trip.poses, truth)
    cells = [_pair(values) for step in (1, 10) for values in errors.steps[step]]
    return (trip.name, *cells, str(errors.lost), f"{errors.absolute_rmse:.3g}", speed)


def _pair(values: FloatArray) -> str:
    return f"{np.median(values):.2g} / {values.max():.2g}" if len(values) else ""


def search_words(trip: TrajectoryRun) -> str:
    """How long frames were sought in all of the map, in a sentence; empty where none was."""
    searches = [result.timings["search"] for result in trip.results if "search" in result.timings]
    if not searches:
        return ""
    return (
        f"searched all of the map for {len(searches)} of {len(trip.results)} frames: {sum(searches):.1f} s, the "
        f"longest {max(searches):.1f} s (--time-limit bounds each, --map-search never leaves them out)"
    )


def trust_words(trip: TrajectoryRun, truth: FloatArray) -> str:
    """Whether the covariances keep their word, in a sentence. Shapes: truth (n, 4, 4)."""
    covariances = np.stack([result.covariance for result in trip.results])
    values = nees(trip.poses, covariances, truth)
    known = values[np.isfinite(values)]
    if not len(known):
        return "covariances: no step has one (unconstrained motions or missing poses)"
    inside = 100 * np.mean(known <= CHI2_HIGH)
    free = len(values) - len(known)
    rest = f"; {free} steps without one (a motion was unconstrained, or a pose is missing)" if free else ""
    return (
        f"covariances against the truth: NEES {np.median(known):.1f} median, {known.mean():.1f} mean (6 expected, with "
        f"an exact truth), {inside:.0f} % of {len(known)} steps below {CHI2_HIGH:.1f} (97.5 % expected){rest}"
    )
