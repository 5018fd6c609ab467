"""Motions that a cost leaves free at its minimum, in words."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.solvers.freedom_motion import LockedChart
from dqreg.solvers.pose_newton import balance
from dqreg.solvers.quadratic import QuadraticForm

# Curvature below this share of the largest is rounding, a hundred times the smallest step of a float. No more, because
# a weak prior beside many exact points is real: 0.1 known beforehand beside 100,000 distances of 1e-5 is 1e-13.
FREE = 2e-14
# A free motion is a turn if that much of its unit vector is one: an axis ten levers away still counts, rounding not.
TURN = 0.1


def free_motions(form: QuadraticForm, chart: LockedChart) -> tuple[str, ...]:
    """Name the allowed motions along which the cost stays as it is."""
    _, hessian, squares = chart.slopes(form)
    unit = balance(squares, chart.turns)
    # At a minimum the Hessian decides: where all points belong to one place every turn has the same cost, although
    # each residual changes.
    values, vectors = np.linalg.eigh(hessian * unit[:, None] * unit)
    largest = np.abs(squares * unit[:, None] * unit).max(initial=0.0)
    free = vectors[:, values <= FREE * largest]
    if not free.shape[1]:
        return ()
    # Equal eigenvalues mix their motions; the basis with turns as large as can be comes apart into turns and shifts.
    free = free @ np.linalg.svd(free[: chart.turns], full_matrices=True)[2].T if chart.turns else free
    shares = np.linalg.norm(free[: chart.turns], axis=0)
    twists = chart.basis @ (unit[:, None] * free)
    twists[3:] += np.cross(twists[:3].T, form.origin_target - chart.pivot).T
    return tuple(
        _turn(twist, form.origin_target) if share > TURN else f"shift along {_words(twist[3:])}"
        for twist, share in zip(twists.T, shares, strict=True)
    )


def _turn(twist: FloatArray, centre: FloatArray) -> str:
    w = twist[:3]
    # The point of the screw axis nearest to the centre.
    x, y, z = centre + np.cross(w, twist[3:]) / (w @ w)
    return f"turn about the axis through ({x:.4g}, {y:.4g}, {z:.4g}) along {_words(w)}"


def _words(vector: FloatArray) -> str:
    unit = vector / np.linalg.norm(vector)
    # An axis has no sign; the largest component is shown positive, and minus zero as zero.
    unit = unit * np.sign(unit[np.abs(unit).argmax()])
    x, y, z = np.where(np.abs(unit) < 0.005, 0.0, unit)
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
