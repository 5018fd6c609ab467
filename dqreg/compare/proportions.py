"""How sure a count of successes is."""

from __future__ import annotations

from scipy.special import betaincinv


def interval(count: int, total: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval of a proportion.

    >>> low, high = interval(0, 100)
    >>> low, round(high, 3)
    (0.0, 0.036)
    """
    tail = 0.5 * (1.0 - 0.95)
    low = float(betaincinv(count, total - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return low, high
