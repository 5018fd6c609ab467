"""Points that are scaled and shifted where they are read: no copy of them is made before one is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import FloatArray, IntArray, shifted

# A move, (4,): what points are multiplied with, and what is then added to them.
UNMOVED = np.array([1.0, 0.0, 0.0, 0.0])


def moved(points: FloatArray, move: FloatArray) -> FloatArray:
    """Points, (n, 3), after a move: the bits that kernels come to."""
    return shifted(points if move[0] == 1.0 else move[0] * points, move[1:])


class LatePoints:
    """What has points, (n, 3): there, or moved once somebody asks for them, of what ``_later`` holds until then."""

    if TYPE_CHECKING:
        points: FloatArray
    else:

        def __getattr__(self, name: str) -> FloatArray:
            known = vars(self)
            if name == "points" and (later := known.get("_later")) is not None:
                # Threads that meet here make the same.
                known["points"] = moved(*later)
                known.pop("_later", None)
            if name not in known:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            return known[name]

    @property
    def _unmoved(self) -> tuple[FloatArray, FloatArray]:
        """Points, (n, 3), and the move by which they are read, (4,)."""
        later: tuple[FloatArray, FloatArray] | None = vars(self).get("_later")
        return (self.points, UNMOVED) if later is None else later

    def _at(self, rows: IntArray) -> FloatArray:
        """Some of the points, (m, 3), alone."""
        points, move = self._unmoved
        return moved(np.take(points, rows, axis=0), move)
