"""One line a frame: what became of it and how far to trust it."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from dqreg.atomic import write_atomically
from dqreg.odometry.engines import Trip
from dqreg.odometry.scans import Scans

HEADER = (
    "frame",
    "name",
    "time",
    "level",
    "x",
    "y",
    "z",
    "sigma_turn_deg",
    "sigma_shift",
    "on_map",
    "rms",
    "seconds",
    "reasons",
)


def write_frames(path: str | Path, trip: Trip, scans: Scans) -> None:
    """Write verdict, place, one-sigmas and reasons of every frame as CSV.

    Parameters
    ----------
    path : str or Path
        File to write.
    trip : Trip
        A run; engines without verdicts leave those columns empty.
    scans : Scans
        Its frames, for names and times.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for number, name in enumerate(scans.names):
        time = "" if scans.times is None else f"{scans.times[number]:.9f}"
        place = [_number(value) for value in trip.poses[number, :3, 3]]
        words = [""] * 6
        if trip.results:
            result = trip.results[number]
            turn, shift = (float(np.sqrt(np.trace(result.covariance[part, part]))) for part in (slice(3), slice(3, 6)))
            words = [
                result.verdict.level,
                *(_number(value) for value in (np.rad2deg(turn), shift, result.inlier_fraction, result.rms)),
                "; ".join(result.verdict.reasons),
            ]
        row = [number, name, time, words[0], *place, *words[1:5], _number(trip.seconds[number]), words[5]]
        writer.writerow(row)
    write_atomically(Path(path), text.getvalue())


def _number(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""
