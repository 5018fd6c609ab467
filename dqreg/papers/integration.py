"""Appendix B of Jia's notes: the order of Euler's step and of a Runge-Kutta method, measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.papers.document import Curve, Figure, Panel, Section, floats
from dqreg.report.table import Column, Table
from dqreg.rigid import quaternion

METHODS: dict[Literal["euler", "rk4"], tuple[str, int]] = {
    "euler": ("Euler, normalised (the notes)", 1),
    "rk4": ("Runge-Kutta-Munthe-Kaas", 4),
}
# A measured order this near to a whole number is that number.
NEAR_ORDER = 0.2
DURATION_S = 2.0
STEP_COUNTS = (16, 32, 64, 128, 256, 512)
START_QUATERNION = (0.5, 0.5, -0.5, 0.5)


@dataclass(frozen=True, slots=True)
class Order:
    """One method of integration."""

    name: str  # What it is
    expected: int  # Order by theory
    slope: float  # Measured order: slope of log error over log step
    steps: tuple[float, ...]  # Length of a step in seconds
    errors_rad: tuple[float, ...]  # Angle between the last orientation and the true one


def wobble(t: float) -> FloatArray:
    """Angular velocity that changes in size and direction."""
    return np.array([1.5 * np.sin(2.0 * t), np.cos(3.0 * t), 0.5 + t])


def measure_orders() -> tuple[Order, ...]:
    """Integrate with ever shorter steps and compare with an independent solver."""
    exact = _reference()
    orders = []
    for method, (name, expected) in METHODS.items():
        errors = []
        for count in STEP_COUNTS:
            times = np.linspace(0.0, DURATION_S, count + 1)
            last = quaternion.integrate(START_QUATERNION, wobble, times, method=method)[-1]
            errors.append(float(2.0 * np.arcsin(min(1.0, float(np.linalg.norm(last - exact)) / 2.0))) * 2.0)
        lengths = DURATION_S / np.array(STEP_COUNTS)
        slope = float(np.polyfit(np.log(lengths), np.log(errors), 1)[0])
        orders.append(Order(name, expected, slope, floats(lengths), tuple(errors)))
    return tuple(orders)


def _reference() -> FloatArray:
    from scipy.integrate import solve_ivp

    def rate(t: float, q: FloatArray) -> FloatArray:
        return np.asarray(quaternion.multiply([0.0, *wobble(t)], q) / 2.0)  # eq. 22

    start = np.array(START_QUATERNION)
    end = solve_ivp(rate, (0.0, DURATION_S), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return np.asarray(end / np.linalg.norm(end))


def integration_section(orders: tuple[Order, ...]) -> Section:
    """Words, table and figure of the orders."""
    table = Table(
        "orders",
        "Error of the last orientation",
        (Column("step", "s", ".4g"), *(Column(order.name, "rad", ".2e") for order in orders)),
        tuple((step, *(order.errors_rad[i] for order in orders)) for i, step in enumerate(orders[0].steps)),
    )
    slopes = Table(
        "slopes",
        "Order of convergence",
        (Column("method"), Column("by theory"), Column("measured", spec=".2f")),
        tuple((order.name, order.expected, order.slope) for order in orders),
        "Slope of the logarithm of the error over that of the step.",
    )
    return Section(
        "integration",
        "Appendix B: integration",
        _finding(orders),
        (
            f"A wobbling angular velocity over {DURATION_S:g} s; the truth is equation 22 solved by SciPy's DOP853 to "
            "13 digits.",
        ),
        (slopes, table),
        (_figure(orders),),
    )


def _finding(orders: tuple[Order, ...]) -> str:
    measured = (
        f"Measured orders: {orders[0].slope:.2f} for the Euler step of the notes, {orders[1].slope:.2f} for the "
        "Runge-Kutta method that they recommend in general terms"
    )
    off = [order for order in orders if not abs(order.slope - order.expected) <= NEAR_ORDER]
    if off:
        theory = ", ".join(f"{order.expected} for {order.name}" for order in off)
        return f"{measured}; by theory {theory}, which this run does not show."
    return f"{measured}, as by theory."


def _figure(orders: tuple[Order, ...]) -> Figure:
    curves = tuple(
        Curve(f"{order.name}: order {order.slope:.2f}", order.steps, order.errors_rad, (), colour, "-", "os"[colour])
        for colour, order in enumerate(orders)
    )
    panel = Panel("step [s]", "error of the last orientation [rad]", curves, log_x=True, log_y=True)
    return Figure("integration", "Error against the length of a step", (panel,))
