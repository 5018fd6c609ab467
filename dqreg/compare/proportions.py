"""How sure a count of successes is."""

from __future__ import annotations

from scipy.special import betaincinv

# Tasks from which on tenths of a percent are worth showing.
MIN_FOR_TENTHS = 200


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


def interval_words(count: int, total: int) -> str:
    """The interval as every table shows it.

    >>> interval_words(4, 5), interval_words(0, 640)
    ('28 to 99 %', '0.0 to 0.6 %')
    """
    digits = 1 if total >= MIN_FOR_TENTHS else 0
    low, high = interval(count, total)
    return f"{100.0 * low:.{digits}f} to {100.0 * high:.{digits}f} %"


def share_words(count: int, total: int) -> str:
    """A count of successes with its interval; one task alone has none.

    >>> share_words(4, 5), share_words(1, 1)
    ('4/5 (28 to 99 %)', '1/1')
    """
    return f"{count}/{total}" + (f" ({interval_words(count, total)})" if total > 1 else "")
