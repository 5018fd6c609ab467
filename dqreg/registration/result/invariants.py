"""What every result promises, checked where it leaves the package: no pose that is none, no covariance that is none.

A violated invariant is a fault of this package, not of the input. It must neither pass as a pose nor stop a night of
registrations, so the result that violates it becomes a failed one that says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.trust.records import Reason, Verdict

# Departure of R^T R from the identity: a hundred times what a product of rotations leaves.
RIGID = 1e-12
# Departure of a covariance from symmetry, and its lowest eigenvalue below zero, in correlations.
SEMIDEFINITE = 1e-9


def violated_invariant(fields: Mapping[str, Any]) -> str:
    """What the fields of a `Registration` promise and do not keep; empty where they keep everything."""
    T_target_source, covariance, level = fields["T_target_source"], fields["covariance"], fields["verdict"].level
    rms, inlier_fraction = fields["rms"], fields["inlier_fraction"]
    nothing = all(map(math.isnan, T_target_source.ravel().tolist()))
    if nothing and level != "failed":
        return f"no pose, but the verdict {level}"
    alternatives = (("alternative", other.T_target_source) for other in fields["alternatives"])
    for name, T in (("pose", T_target_source), *alternatives):
        wrong = "" if nothing and name == "pose" else _not_rigid(T)
        if wrong:
            return f"the {name} {wrong}"
    if nothing and not (np.isnan(rms) and np.isnan(covariance).all()):
        return "no pose, but a root mean square distance or a covariance of one"
    # Where nothing was measured (the frame that a map begins with), neither number is there.
    measured = not math.isnan(inlier_fraction)
    if not nothing and measured and not 0.0 <= rms < math.inf:
        return f"a pose with a root mean square distance of {rms:g}"
    if measured and not -SEMIDEFINITE <= inlier_fraction <= 1.0 + SEMIDEFINITE:
        return f"a share of inliers of {inlier_fraction:g}"
    return _no_covariance(covariance)


def as_failed(fields: Mapping[str, Any], why: str) -> dict[str, Any]:
    """The fields that make a failed result of one that violates an invariant."""
    sentence = f"no pose: an internal error of dqreg, please report it with the data: {why}"
    return {
        "T_target_source": np.full((4, 4), np.nan),
        "verdict": Verdict("failed", (Reason(sentence, "internal_error"), *fields["verdict"].reasons)),
        "covariance": np.full((6, 6), np.nan),
        "observability": (),
        "alternatives": (),
        "rms": np.nan,
        "inlier_fraction": 0.0,
    }


def _not_rigid(T: FloatArray) -> str:
    if T.shape != (4, 4) or not all(map(math.isfinite, T.ravel().tolist())):
        return "holds numbers that are not finite"
    (a, b, c, _), (d, e, f, _), (g, h, i, _), last = T.tolist()
    if last != [0.0, 0.0, 0.0, 1.0]:
        return f"has the last row {last}"
    # Number by number: NumPy takes five times as long. Numbers beyond float64's squares are not within the tolerance.
    squares = a * a + d * d + g * g, b * b + e * e + h * h, c * c + f * f + i * i
    cosines = a * b + d * e + g * h, a * c + d * f + g * i, b * c + e * f + h * i
    gap = max(*(abs(square - 1.0) for square in squares), *map(abs, cosines))
    if not gap <= RIGID:
        return f"is not rigid: its rotation departs from orthonormal by {gap:.3g}"
    return "" if a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) > 0.0 else "is a mirror image"


def _no_covariance(covariance: FloatArray) -> str:
    if covariance.shape != (6, 6):
        return f"a covariance of shape {covariance.shape}"
    missing, held = np.isnan(covariance), covariance
    if missing.any():
        free = missing.diagonal()
        if not np.array_equal(missing, free[:, None] | free):
            return "a covariance that is NaN in places, not in whole rows and columns"
        held = covariance[np.ix_(~free, ~free)]
    if not np.isfinite(held).all() or (held.diagonal() < 0.0).any():
        return "a covariance with infinite numbers or negative variances"
    spread = np.sqrt(held.diagonal())
    spread = np.where(spread > 0.0, spread, 1.0)
    with np.errstate(over="ignore"):
        correlation = held / spread / spread[:, None]
    if not np.isfinite(correlation).all():
        return "a covariance far larger than its own variances"
    if np.abs(correlation - correlation.T).max(initial=0.0) > SEMIDEFINITE:
        return "a covariance that is not symmetric"
    lowest = float(np.linalg.eigvalsh(correlation).min()) if len(held) else 0.0
    return "" if lowest >= -SEMIDEFINITE else f"a covariance with the negative eigenvalue {lowest:.3g}"
