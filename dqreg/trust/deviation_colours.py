"""Colours of deviations that all kinds of colour vision tell apart: blue inside, near white, orange outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg.arrays import FloatArray

# Blue and vermilion are those of Okabe and Ito (2008); either branch only darkens from the middle, and beyond the
# limit follows a colour of its own. A reader who sees no red from green still sees blue from yellow, one a branch.
STOPS = ((0, 62, 110), (0, 114, 178), (134, 188, 222), (247, 247, 247), (246, 185, 122), (213, 94, 0), (140, 55, 0))
BELOW, ABOVE = (30, 10, 70), (75, 0, 20)
# What belongs to something else.
BEYOND = (128, 128, 128)

ByteArray = NDArray[np.uint8]


def colours_of(values: FloatArray, limit: float, reach: float = np.inf) -> ByteArray:
    """Colour of each deviation.

    Parameters
    ----------
    values : ndarray, (n,)
        Deviations; without signs they take the upper branch.
    limit : float
        Where the scale ends on both sides, > 0, a length.
    reach : float
        Deviations beyond are grey.

    Returns
    -------
    ndarray of uint8, (n, 3)
        Red, green, blue.

    Examples
    --------
    >>> colours_of(np.array([-1.0, 0.0, 1.0, 1.5, 9.0]), 1.0, reach=5.0).tolist()
    [[0, 62, 110], [247, 247, 247], [140, 55, 0], [75, 0, 20], [128, 128, 128]]
    """
    stops = np.array(STOPS, dtype=np.float64)
    at = np.linspace(-limit, limit, len(stops))
    colours = np.zeros((len(values), 3), dtype=np.uint8)
    for k in range(3):
        colours[:, k] = np.rint(np.interp(values, at, stops[:, k]))
    colours[values < -limit] = BELOW
    colours[values > limit] = ABOVE
    colours[np.abs(values) > reach] = BEYOND
    return colours
