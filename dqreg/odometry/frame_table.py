"""The frames of a run, one by one: as CSV and as plain values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dqreg.files.atomic import write_atomically
from dqreg.files.csv_text import csv_text
from dqreg.odometry.run_sequence import TrajectoryRun
from dqreg.odometry.scans import Scans
from dqreg.registration.result.result import Registration

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
    "search_seconds",
    "reasons",
)


def write_frames(path: str | Path, trip: TrajectoryRun, scans: Scans) -> None:
    """Write verdict, place, one-sigmas and reasons of every frame as CSV."""
    rows = []
    for number, name in enumerate(scans.names):
        time = "" if scans.times is None else f"{scans.times[number]:.9f}"
        place = [_number(value) for value in trip.poses[number, :3, 3]]
        words = [""] * 7
        if trip.results:
            result = trip.results[number]
            words = [
                result.verdict.level,
                *(_number(value) for value in (*_sigmas(result), result.inlier_fraction, result.rms)),
                _number(result.timings.get("search", np.nan)),
                "; ".join(result.verdict.reasons),
            ]
        row = [number, name, time, words[0], *place, *words[1:5], _number(trip.seconds[number]), *words[5:]]
        rows.append(row)
    write_atomically(Path(path), csv_text(HEADER, rows))


def to_records(trip: TrajectoryRun, scans: Scans) -> list[dict[str, Any]]:
    """The frames as plain values."""
    records = []
    for number, name in enumerate(scans.names):
        result = trip.results[number] if trip.results else None
        turn, shift = (None, None) if result is None else _sigmas(result)
        records.append(
            {
                "frame": number,
                "name": name,
                "time": None if scans.times is None else float(scans.times[number]),
                "level": None if result is None else result.verdict.level,
                "T_target_source": trip.poses[number],
                "sigma_turn_deg": turn,
                "sigma_shift": shift,
                "on_map": None if result is None else result.inlier_fraction,
                "rms": None if result is None else result.rms,
                "seconds": float(trip.seconds[number]),
                "search_seconds": None if result is None else result.timings.get("search"),
                "reasons": [] if result is None else list(result.verdict.reasons),
                "codes": [] if result is None else list(result.verdict.codes),
            }
        )
    return records


def _sigmas(result: Registration) -> tuple[float, float]:
    """One sigma of the turn in degrees and of the shift."""
    turn, shift = (float(np.sqrt(np.trace(result.covariance[part, part]))) for part in (slice(3), slice(3, 6)))
    return float(np.rad2deg(turn)), shift


def _number(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""
