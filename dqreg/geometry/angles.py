"""Angles round an axis: the gaps between neighbours, of which the widest says what is not surrounded."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray


def gaps_around(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles in order, and the gap from each to the next, the first closing the round. Shapes: (..., n) all.

    >>> [each.tolist() for each in gaps_around(np.array([1.0, 0.0, 3.0]))]
    [[0.0, 1.0, 3.0], [1.0, 2.0, 3.2831853071795862]]
    """
    ordered = np.sort(angles, axis=-1)
    closed = np.concatenate([ordered, ordered[..., :1] + 2.0 * np.pi], axis=-1)
    return ordered, np.diff(closed, axis=-1)
