"""How much time is left, learned from what each engine has taken so far."""

from __future__ import annotations

from collections.abc import Hashable, Iterable


class Clock:
    """Estimate of the time that is left.

    Engines differ a thousandfold in speed, so each has its own rate; one that has not run yet is given the mean.

    >>> clock = Clock([("a", 1.0), ("a", 1.0), ("b", 2.0)])
    >>> clock.done("a", 1.0, seconds=3.0)
    >>> clock.seconds_left
    9.0
    """

    def __init__(self, jobs: Iterable[tuple[Hashable, float]]) -> None:
        self._left: dict[Hashable, float] = {}
        self._worked: dict[Hashable, float] = {}
        self._spent: dict[Hashable, float] = {}
        for engine, work in jobs:
            self._left[engine] = self._left.get(engine, 0.0) + work

    def done(self, engine: Hashable, work: float, seconds: float) -> None:
        """Note that a job is done."""
        self._left[engine] = self._left.get(engine, 0.0) - work
        if seconds > 0.0:
            self._worked[engine] = self._worked.get(engine, 0.0) + work
            self._spent[engine] = self._spent.get(engine, 0.0) + seconds

    @property
    def seconds_left(self) -> float:
        """Seconds that the remaining jobs will take; NaN before the first is done."""
        worked = sum(self._worked.values())
        if not worked:
            return float("nan")
        mean = sum(self._spent.values()) / worked
        rates = {engine: self._spent[engine] / work for engine, work in self._worked.items() if work}
        return sum(max(0.0, left) * rates.get(engine, mean) for engine, left in self._left.items())
