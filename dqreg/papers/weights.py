"""The question that the paper of 1991 leaves open: how to weigh points against directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dqreg.papers.directions import PAPER_WEIGHTS
from dqreg.papers.document import Curve, Figure, Panel, Section, floats
from dqreg.papers.simulation import SetUp
from dqreg.papers.trials import exceeds
from dqreg.report.table import Column, Estimate, Table
from dqreg.solvers import likelihood_weights
from dqreg.synth.parts.blocks import FEEDER_DIAGONAL

FEATURE_COUNTS = (5, 5)
SIGMA_P = 0.05
# What the least possible error is of itself.
ONE = Estimate(1.0, 0.0)
NOISE_RATIOS = np.geomspace(0.01, 100.0, 13)

Weighing = Callable[[float, float], tuple[float, float]]


def _likely(sigma_p: float, sigma_n: float) -> tuple[float, float]:
    weights = likelihood_weights(sigma_p, sigma_n**2)
    return float(weights.point_weights), float(weights.direction_weights)


# From the noise (sigma_p, sigma_n) to (beta, alpha); most of them do not look at it.
WEIGHINGS: dict[str, Weighing] = {
    "likelihood": _likely,
    "sigma_n taken twice too large": lambda sigma_p, sigma_n: _likely(sigma_p, 2.0 * sigma_n),
    "alpha = beta (0.05 size)^2": lambda sigma_p, sigma_n: (1.0, (0.05 * FEEDER_DIAGONAL) ** 2),
    "alpha = beta = 1, in mm": lambda sigma_p, sigma_n: PAPER_WEIGHTS,
    # The same part in metres: squared distances shrink by a million, directions stay.
    "alpha = beta = 1, in m": lambda sigma_p, sigma_n: (PAPER_WEIGHTS[0] * 1e-6, PAPER_WEIGHTS[1]),
}


@dataclass(frozen=True, slots=True)
class Loss:
    """One way to weigh at one ratio of noise: errors over the least possible ones."""

    weighing: str  # Name of the way
    ratio: float  # sigma_n * size / sigma_p
    # turn, shift: Simulated rms error over the Cramer-Rao bound, of rotation and of the place of the part's centre
    turn: Estimate
    shift: Estimate
    # predicted_turn, predicted_shift: The same by first-order theory
    predicted_turn: float
    predicted_shift: float


def measure_weights(rng: np.random.Generator, choices: int = 10, trials: int = 1000) -> tuple[Loss, ...]:
    """Sweep the ratio of noise for every way to weigh."""
    setup = SetUp.draw(rng, FEATURE_COUNTS, choices, trials)
    return tuple(_loss(setup, name, float(ratio)) for name in WEIGHINGS for ratio in NOISE_RATIOS)


def _loss(setup: SetUp, name: str, ratio: float) -> Loss:
    sigmas = (SIGMA_P, ratio * SIGMA_P / FEEDER_DIAGONAL)
    weights = WEIGHINGS[name](*sigmas)
    found, bound, predicted = setup.simulate(sigmas, weights), setup.predict(sigmas), setup.predict(sigmas, weights)
    turn = Estimate(found.turn_deg.value / bound[0], found.turn_deg.error / bound[0])
    shift = Estimate(found.shift.value / bound[1], found.shift.error / bound[1])
    return Loss(name, ratio, turn, shift, predicted[0] / bound[0], predicted[1] / bound[1])


def weights_section(losses: tuple[Loss, ...]) -> Section:
    """Words, table and figure of the measurement."""
    by_name = {name: [loss for loss in losses if loss.weighing == name] for name in WEIGHINGS}
    worst = {name: max(loss.turn.value for loss in row) for name, row in by_name.items()}
    table = Table(
        "weights",
        "Rotation error over the least possible error",
        (Column("ratio"), *(Column(name) for name in WEIGHINGS)),
        tuple((float(ratio), *(row[i].turn for row in by_name.values())) for i, ratio in enumerate(NOISE_RATIOS)),
        "1 is the Cramer-Rao bound. In brackets: one Monte-Carlo standard error, in units of the last digits. Ratio: "
        "sigma_n * size / sigma_p.",
    )
    return Section(
        "weights",
        "Weights: the question the paper leaves open",
        _finding(losses, worst),
        (
            f"Five points and five directions on the stand-in, taken as millimetres, with sigma_p = {SIGMA_P:g} mm. "
            "The bound is the inverse of the Fisher information of points with noise alike in all coordinates and of "
            "unit directions that tilt alike both ways. A fixed pair of weights is right at the one ratio "
            "sigma_n / sigma_p = sqrt(beta / alpha) and loses on both sides of it.",
            "Sigmas come from the sensor, from residuals, or, for a normal fitted to k neighbours, from "
            "dqreg.solvers.normal_variance: an edge or a grazing view then weighs itself down.",
        ),
        (table,),
        (_figure(by_name),),
    )


def _finding(losses: tuple[Loss, ...], worst: dict[str, float]) -> str:
    likely, off, heuristic, mm, m = worst.values()
    best = min((loss.turn for loss in losses), key=lambda turn: turn.value)
    above = [loss.turn for loss in losses if loss.weighing == "likelihood" and exceeds(loss.turn, ONE)]
    below = [loss.turn for loss in losses if exceeds(ONE, loss.turn)]
    words = ["Take beta = 1 / sigma_p^2 and alpha = 1 / sigma_n^2. " if not (above or below) else ""]
    if above:
        words.append(
            f"Weights of likelihood miss the Cramer-Rao bound at {len(above)} of {len(NOISE_RATIOS)} ratios, at worst "
            f"{likely:.3f} times it"
        )
    else:
        words.append(
            f"Weights of likelihood reach the Cramer-Rao bound at every ratio (at worst {likely:.3f} times it)"
        )
    smallest = f"the smallest loss of all is {best.value:.3f}, with a standard error of {best.error:.3f}"
    if below:
        words.append(
            f"; {len(below)} losses lie below the bound, so the bound or the simulation is wrong ({smallest}). "
        )
    else:
        words.append(f"; nothing beats the bound ({smallest}). ")
    words.append(
        f"A sigma_n wrong by a factor of two costs {100 * (off - 1):.0f} % at most; the fixed rule alpha = beta (0.05 "
        f"size)^2 up to a factor of {heuristic:.1f}; alpha = beta = 1 up to {mm:.1f} in millimetres and {m:.1f} in "
        "metres"
    )
    differ = abs(m - mm) > 0.1 * mm
    words.append(": it depends on the unit of length, likelihood weights do not." if differ else ".")
    return "".join(words)


def _figure(by_name: dict[str, list[Loss]]) -> Figure:
    panels = []
    for kind, title in (("turn", "Rotation"), ("shift", "Position of the part's centre")):
        curves = []
        for colour, (name, row) in enumerate(by_name.items()):
            x, found = floats(loss.ratio for loss in row), [getattr(loss, kind) for loss in row]
            predicted = floats(getattr(loss, f"predicted_{kind}") for loss in row)
            curves.append(Curve("", x, predicted, colour=colour))
            values, errors = floats(f.value for f in found), floats(f.error for f in found)
            curves.append(Curve(name, x, values, errors, colour, "", "osD^v"[colour]))
        panels.append(
            Panel(
                "sigma_n * size / sigma_p", "rms error / Cramer-Rao bound", tuple(curves), title, log_x=True, log_y=True
            )
        )
    return Figure(
        "weights",
        "Loss of each way to weigh against the least possible error",
        tuple(panels),
        "Markers: simulation with one standard error. Lines: first-order theory of the same weights.",
    )
