"""Stages of the search: what is reported of each, and when to stop."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, IntArray


@dataclasses.dataclass(frozen=True)
class Stage:
    """Report of one stage of the search."""

    name: str  # What was done: "proposed", "screened", "refined roughly", "refined", "turned" or "refined finely"
    poses: int  # Poses still in the race
    seconds: float  # Time since the search began


Observer = Callable[[Stage], object]


@dataclasses.dataclass(frozen=True)
class Poses:
    """Poses, the best first."""

    R: FloatArray  # (n, 3, 3): Rotations
    t: FloatArray  # (n, 3): Translations

    def __len__(self) -> int:
        return len(self.R)

    def __getitem__(self, rows: IntArray) -> Poses:
        return Poses(self.R[rows], self.t[rows])

    def __add__(self, other: Poses) -> Poses:
        return Poses(np.concatenate([self.R, other.R]), np.concatenate([self.t, other.t]))

    @property
    def inverse(self) -> Poses:
        """From target to source."""
        back = self.R.transpose(0, 2, 1)
        return Poses(back, -np.einsum("nij,nj->ni", back, self.t))

    def matrix(self, row: int) -> FloatArray:
        """One of them, (4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R[row], self.t[row]
        return T


class Clock:
    """Tells the stages to an observer, and whether to stop after each."""

    def __init__(
        self, limit: float | None = None, observe: Observer | None = None, now: Callable[[], float] | None = None
    ) -> None:
        self._now = now or time.perf_counter
        self._began = self._now()
        self._limit, self._observe = limit, observe

    def is_up(self, stage: str, poses: Poses) -> bool:
        """Report a finished stage; whether the search shall end here."""
        seconds = self._now() - self._began
        if self._observe is not None and self._observe(Stage(stage, len(poses), seconds)) is False:
            return True
        return self._limit is not None and seconds >= self._limit
