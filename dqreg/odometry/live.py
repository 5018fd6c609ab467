"""The odometry in the browser while it runs: map, frame, trajectory."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_vectors
from dqreg.registration.result.result import Registration
from dqreg.report.colours import SOURCE, TARGET, rgb
from dqreg.report.live_server import add_ellipsoid, open_server, place
from dqreg.rigid import pose

# Points of a frame that are shown, and points of the map at most.
FRAME_POINTS, MAX_MAP_POINTS = 20_000, 400_000
# Frames from one picture of the map to the next.
FRAMES_PER_MAP_PICTURE = 5
# Edge of the map's cells over the median range of the first frame.
CELL_MEDIAN_RANGES = 0.01
LEVEL_COLOURS = {"accepted": (30, 90, 200), "suspect": (230, 140, 0), "failed": (200, 30, 30)}


class LiveMap:
    """A page that shows each frame as it is placed; `show` is called after `Odometry.register_frame`."""

    def __init__(self, port: int = 8080) -> None:
        self.server = open_server(port, "dqreg: odometry")
        self.sensor: Any = None  # The axes of the last frame's pose
        self._said = self.server.gui.add_markdown("waiting for the first frame")
        self._cells = np.zeros((0, 3), dtype=np.int32)
        self._cell, self._scale = 0.0, 1.0
        self._path: list[FloatArray] = []
        self._levels: list[str] = []

    def show(self, points: Any, result: Registration) -> None:
        """Show a frame, (n, 3) in the sensor's frame, and its result."""
        found, verdict = result.T_target_source, result.verdict
        given = as_vectors(points, "points", finite=False)
        frame = given[np.isfinite(given).all(axis=1)]
        self._levels.append(verdict.level)
        self._said.content = f"frame {len(self._levels)}: **{verdict.level}**\n\n" + "\n".join(
            f"- {reason}" for reason in verdict.reasons
        )
        if not np.isfinite(found).all() or not len(frame):
            return
        if not self._cell:
            # What browsers draw is single precision, and the map begins at its origin: lengths stay as they are.
            self._scale = float(np.median(np.linalg.norm(frame, axis=1)))
            self._cell = CELL_MEDIAN_RANGES * self._scale
        shown = frame[:: max(1, len(frame) // FRAME_POINTS)]
        colour = rgb(SOURCE) if verdict.level == "accepted" else LEVEL_COLOURS[verdict.level]
        place(self._cloud("/frame", shown, colour), found)
        self.sensor = self._axes()
        place(self.sensor, found)
        self._path.append(found[:3, 3].copy())
        if verdict.level == "accepted":
            self._grow(pose.apply(found, frame))
        self._draw_path()
        self._draw_ellipsoid(result)

    def _cloud(self, name: str, points: FloatArray, colour: tuple[int, int, int]) -> Any:
        size = 0.004 * self._scale
        return self.server.scene.add_point_cloud(name, points, colour, point_size=size, precision="float32")

    def _axes(self) -> Any:
        length = 0.15 * self._scale
        return self.server.scene.add_frame("/sensor", axes_length=length, axes_radius=0.03 * length)

    def _grow(self, points: FloatArray) -> None:
        cells = np.unique(np.floor(points / self._cell).astype(np.int32), axis=0)
        self._cells = np.unique(np.concatenate([self._cells, cells]), axis=0)
        if len(self._cells) > MAX_MAP_POINTS:
            # A coarser map of all of it, rather than a part of it.
            self._cell *= 2.0
            self._cells = np.unique(self._cells // 2, axis=0)
        if len(self._path) % FRAMES_PER_MAP_PICTURE == 1:
            self.server.scene.add_point_cloud(
                "/map", (self._cells + 0.5) * self._cell, rgb(TARGET), point_size=0.4 * self._cell, precision="float32"
            )

    def _draw_path(self) -> None:
        if len(self._path) < 2:
            return
        path = np.array(self._path)
        segments = np.stack([path[:-1], path[1:]], axis=1)
        self.server.scene.add_line_segments(
            "/trajectory", segments, LEVEL_COLOURS["accepted"], thickness=0.01 * self._scale
        )

    def _draw_ellipsoid(self, result: Registration) -> None:
        block = result.covariance[3:, 3:]
        if not np.isfinite(block).all() or not np.trace(block) > 0.0:
            return
        values, vectors = np.linalg.eigh(block)
        axes = (vectors * np.sqrt(np.maximum(values, 0.0))).T
        _, larger = add_ellipsoid(self.server, "/ellipsoid", axes, result.T_target_source[:3, 3], self._scale)
        self._said.content += f"\n\nThe ellipsoid is one sigma of the place, drawn {larger:,.0f} times its size."
