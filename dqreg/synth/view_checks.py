"""Checks of a scanner's settings that several scanners share."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, as_vectors
from dqreg.errors import InputError

# More rays than this need more memory than most machines have; no scanner has as many pixels.
MOST_RAYS = 20_000_000


def check_views(views: object, stand_off: object) -> FloatArray:
    """Return the checked directions from the part to its sensors.

    >>> check_views([(0, 0, 1)], 1.5).tolist()
    [[0.0, 0.0, 1.0]]
    """
    directions = as_vectors(views, "views")
    if not len(directions) or not np.linalg.norm(directions, axis=1).all():
        raise InputError(f"views must be one or more directions that are not zero; got {views!r}")
    if not is_within(stand_off, 0.5, 1e6):
        raise InputError(
            "stand_off must be above 0.5 diagonals, or the sensor is in the part, and below a million; "
            f"got {stand_off!r}"
        )
    return directions


def require_rays(views: int, **counts: object) -> None:
    """Raise unless the sides of an image are whole numbers and all images have a sane number of rays.

    >>> require_rays(2, rings=16, azimuths=360)
    """
    total = views
    for name, count in counts.items():
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise InputError(f"{name} must be a whole number above 0; got {count!r}")
        total *= count
    if total > MOST_RAYS:
        name, count = next(iter(counts.items()))
        raise InputError(
            f"{name} is too large: {count!r} makes {total:.3g} rays in all {views} views; at most {MOST_RAYS:.3g}"
        )


def unit(vectors: FloatArray) -> FloatArray:
    """Scale vectors to length one.

    Shapes: vectors (..., 3), returns (..., 3).
    """
    directions: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return directions


def is_within(value: object, low: float, high: float) -> bool:
    """Whether a value is a number strictly between two others.

    >>> is_within(1, 0.5, 2.0), is_within("1", 0.5, 2.0)
    (True, False)
    """
    return isinstance(value, (int, float)) and not isinstance(value, bool) and low < value < high
