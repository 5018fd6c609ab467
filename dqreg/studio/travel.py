"""An odometry as it runs: its map, its frame and its trajectory, written for the page after every frame."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_vectors
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.json_records import read_json
from dqreg.files.strict_json import plain
from dqreg.registration.batch.watch import Failure
from dqreg.registration.batch.worker import Worker
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.studio.drawing import DrawnFrame, drawn_pose
from dqreg.studio.payloads import cloud_payload, shades

STATE = "state.json"
# Points of a frame and of the map that are drawn.
FRAME_POINTS, MAP_POINTS = 20_000, 100_000
# Edge of the map's cells over the median range of the first frame.
CELL_RANGES = 0.01
# Drawings that are kept: the page may be one frame behind.
KEPT_DRAWINGS = 3
# Ranges of the first frame that the drawing takes for its size.
DRAWN_RANGES = 4.0
# Runs an odometry of scans, and tells a `Story` in a folder; the command line has it, which knows every room.
Drive = Callable[[Path, Path], None]
BEFORE: dict[str, Any] = {"frames": 0, "of": None, "levels": [], "path": [], "over": False, "error": None}


class Travel:
    """The odometry of a server, in a worker process from the first question on."""

    def __init__(self, scans: Path, folder: Path, drive: Drive) -> None:
        if not scans.exists():
            raise InputError(f"cannot read {scans}: no such file or folder")
        self.scans, self.folder, self._drive = scans, folder, drive
        self._worker = Worker(os.cpu_count() or 1)
        self._thread: threading.Thread | None = None
        self._closing = False

    def state(self) -> dict[str, Any]:
        """How far it is, with what there is to draw."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()
        path = self.folder / STATE
        found = read_json(path, "the state of a drive") if path.is_file() else {**BEFORE}
        return found | {"name": self.scans.name, "command": f"dqreg odometry {self.scans.name} --out poses.txt"}

    def close(self) -> None:
        """End the work; its folder may be removed after that."""
        self._closing = True
        self._worker.close()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        words = None
        try:
            answer = self._worker.call(partial(self._drive, self.scans, self.folder))
            words = answer.message if isinstance(answer, Failure) else None
        except InputError as error:
            words = str(error)
        if words is not None and not self._closing:
            write_atomically(self.folder / STATE, json.dumps(self.state() | {"error": words, "over": True}))


class Story:
    """What the page is told."""

    def __init__(self, folder: Path, count: int) -> None:
        self._folder = folder
        self._state: dict[str, Any] = {**BEFORE, "of": count, "levels": [], "path": []}
        self._cells = np.zeros((0, 3), dtype=np.int64)
        self._cell = 0.0
        self._frame = DrawnFrame(np.zeros(3), 1.0)

    def show(self, points: Any, result: Registration) -> None:
        """A frame that was placed, (n, 3) in the sensor's frame."""
        given = as_vectors(points, "points", finite=False)
        frame = given[np.isfinite(given).all(axis=1)]
        state, found = self._state, result.T_target_source
        state["frames"] += 1
        state["levels"].append(result.verdict.level)
        state["reasons"] = list(result.verdict.reasons)
        if np.isfinite(found).all() and len(frame):
            if not self._cell:
                far = float(np.median(np.linalg.norm(frame, axis=1)))
                self._cell, self._frame = CELL_RANGES * far, DrawnFrame(np.zeros(3), DRAWN_RANGES * far)
                state["size"] = DRAWN_RANGES * far
            state["T"] = drawn_pose(found, 1.0, self._frame, self._frame)
            state["path"].append(self._frame.to_drawn(found[:3, 3]).tolist())
            state["frame"] = self._drawn("frame", frame[:: max(1, len(frame) // FRAME_POINTS)], lit=True)
            if result.verdict.level == "accepted":
                self._grow(pose.apply(found, frame))
                middles = np.asarray(self._cells + 0.5, dtype=np.float64) * self._cell
                state["map"] = self._drawn("map", middles, lit=False)
        self._tell()

    def end(self) -> None:
        """It is over."""
        self._state["over"] = True
        self._tell()

    def _tell(self) -> None:
        write_atomically(self._folder / STATE, json.dumps(plain(self._state), allow_nan=False))

    def _grow(self, points: FloatArray) -> None:
        cells = np.unique(np.floor(points / self._cell).astype(np.int64), axis=0)
        self._cells = np.unique(np.concatenate([self._cells, cells]), axis=0)
        while len(self._cells) > MAP_POINTS:
            # A coarser map of all of it, rather than a part of it.
            self._cell *= 2.0
            self._cells = np.unique(self._cells // 2, axis=0)

    def _drawn(self, name: str, points: FloatArray, *, lit: bool) -> dict[str, Any]:
        number = self._state["frames"]
        # In random order any first part of them is as even: less is drawn while the view moves.
        points = np.random.default_rng(0).permutation(points)
        words, data = cloud_payload(points, self._frame, (np.arange(len(points)), np.arange(0)))
        write_atomically(self._folder / f"{name}-{number}.bin", data + (shades(points) if lit else b""))
        (self._folder / f"{name}-{number - KEPT_DRAWINGS}.bin").unlink(missing_ok=True)
        return words | {"file": f"{name}-{number}.bin"}
