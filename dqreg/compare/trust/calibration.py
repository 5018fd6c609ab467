"""Whether the confidence of the verdicts is what it says, and its coefficients fitted anew."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

from dqreg._arrays import FloatArray
from dqreg.compare.proportions import interval, interval_words
from dqreg.compare.trust.rates import percent
from dqreg.compare.trust.trial import Trial
from dqreg.errors import InputError
from dqreg.report.table import Column, Table
from dqreg.trust.confidence import NAMES, OFFSET, WEIGHTS

# Bins of equal width.
BIN_COUNT = 10
# Trials without which a fit is a guess; penalty of squared weights, in trials.
MIN_TRIALS, PENALTY_TRIALS = 150, 1.0
# Figures that never speak against a pose, and those that may speak either way; all others never speak for it. Without
# signs a fit to few tasks lets chance decide them, which tells beyond the tasks: on real scans.
SUPPORTING_FIGURES = {"inliers", "inliers_near", "carriers", "many_planes"}
EITHER_WAY_FIGURES = {"other_objects", "border", "searched"}

Fit = Callable[[Sequence[Trial]], tuple[float, dict[str, float]]]


@dataclasses.dataclass(frozen=True)
class Bin:
    """Trials of one range of confidence."""

    low: float
    high: float
    trials: int
    confidence: float  # Mean
    right: float  # Fraction of right poses
    right_low: float  # 95 % interval of it
    right_high: float


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Confidence against the fraction of right poses."""

    bins: tuple[Bin, ...]
    trials: int
    # Mean distance of confidence and fraction over the bins, weighed by their trials; and what a perfectly calibrated
    # confidence would come to with so few trials
    error: float
    expected_by_chance: float


def calibration_of(trials: Sequence[Trial]) -> Calibration:
    """Reliability of the trials that have a confidence."""
    known = [one for one in trials if math.isfinite(one.confidence)]
    p, right = np.array([one.confidence for one in known]), np.array([one.right for one in known], dtype=np.float64)
    at = np.minimum((p * BIN_COUNT).astype(np.int64), BIN_COUNT - 1) if len(known) else np.zeros(0, dtype=np.int64)
    made, error, chance = [], 0.0, 0.0
    for index in range(BIN_COUNT):
        here = at == index
        count = int(here.sum())
        if not count:
            continue
        mean, share = float(p[here].mean()), float(right[here].mean())
        low, high = index / BIN_COUNT, (index + 1) / BIN_COUNT
        made.append(Bin(low, high, count, mean, share, *interval(round(share * count), count)))
        error += count * abs(mean - share) / len(known)
        # Mean absolute deviation of a binomial share, by the normal law.
        chance += count * math.sqrt(2.0 / math.pi * float((p[here] * (1.0 - p[here])).sum())) / count / len(known)
    return Calibration(tuple(made), len(known), error if known else math.nan, chance if known else math.nan)


def calibration_table(found: Calibration) -> Table:
    """The bins as a table."""
    heads = ("confidence", "tasks", "mean confidence", "right poses", "95 % interval")
    rows = tuple(
        (
            f"{percent(one.low)} - {percent(one.high)}", one.trials, percent(one.confidence), percent(one.right),
            interval_words(round(one.right * one.trials), one.trials),
        )
        for one in found.bins
    )  # fmt: skip
    note = (
        f"Expected calibration error {percent(found.error)} over {found.trials} tasks; so few tasks would give "
        f"{percent(found.expected_by_chance)} by chance where it is perfect."
    )
    columns = tuple(Column(head, align="left" if head == heads[0] else "right") for head in heads)
    return Table("calibration", "Confidence of the verdict against the fraction of right poses", columns, rows, note)


def fit_confidence(trials: Sequence[Trial]) -> tuple[float, dict[str, float]]:
    """Offset and weights of the logistic map, by penalised likelihood, each weight of the sign that its figure has."""
    known = [one for one in trials if len(one.figures) == len(NAMES)]
    if len(known) < MIN_TRIALS:
        raise InputError(f"{MIN_TRIALS} tasks are needed to fit the confidence; got {len(known)}: ask for more --seeds")
    X = np.array([one.figures for one in known], dtype=np.float64)
    right = np.array([one.right for one in known], dtype=np.float64)
    rows = np.column_stack([np.ones(len(X)), X])

    def cost(weights: FloatArray) -> tuple[float, FloatArray]:
        logit = rows @ weights
        loss = float(np.logaddexp(0.0, logit).sum() - right @ logit) + PENALTY_TRIALS * float(weights[1:] @ weights[1:])
        slope = rows.T @ (1.0 / (1.0 + np.exp(-logit)) - right)
        slope[1:] += 2.0 * PENALTY_TRIALS * weights[1:]
        return loss, slope

    bounds = [(None, None), *(_bounds(name) for name in NAMES)]
    found = minimize(cost, np.zeros(rows.shape[1]), jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(found[0]), {name: float(weight) for name, weight in zip(NAMES, found[1:], strict=True)}


def rescale_confidence(trials: Sequence[Trial]) -> tuple[float, dict[str, float]]:
    """Offset and weights of the present map after its logarithm of the odds is shifted, that of doubted poses apart.

    Two numbers, for a set that is too small for all weights: among poses that something speaks against, and among all
    others, the order of the confidences stays, and so does what a limit on them refuses once it is shifted along.
    """
    known = [one for one in trials if len(one.figures) == len(NAMES)]
    if len(known) < MIN_TRIALS:
        raise InputError(f"{MIN_TRIALS} tasks are needed to fit the confidence; got {len(known)}: ask for more --seeds")
    X, right = np.array([one.figures for one in known]), np.array([one.right for one in known], dtype=np.float64)
    logit = OFFSET + X @ np.array([WEIGHTS[name] for name in NAMES])
    doubted = X[:, NAMES.index("suspect")]
    # One wrong pose more of either sort than there were (the rule of succession): no map is certain.
    sorts = [sort for sort in (0.0, 1.0) if np.any((doubted > 0.5) == sort)]
    typical = [np.median(logit[(doubted > 0.5) == sort]) for sort in sorts]
    logit, doubted = np.r_[logit, typical], np.r_[doubted, sorts]
    right = np.r_[right, np.zeros(len(sorts))]

    def cost(numbers: FloatArray) -> float:
        found = logit + numbers[0] + numbers[1] * doubted
        return float(np.logaddexp(0.0, found).sum() - right @ found)

    shift, of_doubted = minimize(cost, np.zeros(2)).x
    return float(OFFSET + shift), {**WEIGHTS, "suspect": WEIGHTS["suspect"] + float(of_doubted)}


def cross_validated(trials: Sequence[Trial], fit: Fit) -> Calibration:
    """Reliability where the tasks of each seed have the confidence of a map that was fitted to all other seeds."""
    known = [one for one in trials if len(one.figures) == len(NAMES)]
    found = []
    for seed in sorted({one.seed for one in known}):
        offset, weights = fit([one for one in known if one.seed != seed])
        for one in known:
            if one.seed == seed:
                logit = offset + float(np.dot(one.figures, [weights[name] for name in NAMES]))
                p = 1.0 / (1.0 + math.exp(-max(-30.0, min(30.0, logit))))
                found.append(dataclasses.replace(one, confidence=p))
    return calibration_of(found)


def _bounds(name: str) -> tuple[float | None, float | None]:
    if name in EITHER_WAY_FIGURES:
        return None, None
    return (0.0, None) if name in SUPPORTING_FIGURES else (None, 0.0)


def as_code(offset: float, weights: dict[str, float]) -> str:
    """The lines of `dqreg.trust.confidence` that hold them."""
    rows = "".join(f'    "{name}": {weight:.4f},\n' for name, weight in weights.items())
    return f"OFFSET = {offset:.4f}\nWEIGHTS: dict[str, float] = {{\n{rows}}}\n"
