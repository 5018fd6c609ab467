"""Appendix D of Jia's notes: every Jacobian against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.papers.document import Section
from dqreg.report.table import Column, Table, short_number
from dqreg.rigid import quaternion as quat

UNIT_STEP = 1e-5
# Errors above it are none of the rounding of the differences, some 1e-11 times the size of the numbers.
DIFFERENCE_ROUNDING = 1e-9

Vectors = tuple[FloatArray, FloatArray, FloatArray]
Function = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Jacobian:
    """One Jacobian."""

    equation: str  # Its number in the notes
    says: str  # What is differentiated by what
    symbol: str  # Name in ``dqreg.quaternion``
    error: float  # Largest difference from central differences over all draws, entry by entry


def _pure(v: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], v])


def _sandwich(q: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(quat.multiply(quat.multiply(q, _pure(v)), quat.conjugate(q))[1:])


# Equation, words, name, Jacobian of (p, q, v), then the function and where it is differentiated.
CASES: tuple[tuple[str, str, str, Callable[..., FloatArray], Callable[..., tuple[Function, FloatArray]]], ...] = (
    ("35", "p q by p", "d_pq_d_p", lambda p, q, v: quat.d_pq_d_p(q),
     lambda p, q, v: (lambda x: quat.multiply(x, q), p)),
    ("36", "p q* by p", "d_pqc_d_p", lambda p, q, v: quat.d_pqc_d_p(q),
     lambda p, q, v: (lambda x: quat.multiply(x, quat.conjugate(q)), p)),
    ("37", "p q by q", "d_pq_d_q", lambda p, q, v: quat.d_pq_d_q(p),
     lambda p, q, v: (lambda x: quat.multiply(p, x), q)),
    ("38", "p q* by q", "d_pqc_d_q", lambda p, q, v: quat.d_pqc_d_q(p),
     lambda p, q, v: (lambda x: quat.multiply(p, quat.conjugate(x)), q)),
    ("39", "q v by q", "d_qv_d_q", lambda p, q, v: quat.d_qv_d_q(v),
     lambda p, q, v: (lambda x: quat.multiply(x, _pure(v)), q)),
    ("40", "v q by q", "d_vq_d_q", lambda p, q, v: quat.d_vq_d_q(v),
     lambda p, q, v: (lambda x: quat.multiply(_pure(v), x), q)),
    ("41", "v q by v", "d_vq_d_v", lambda p, q, v: quat.d_vq_d_v(q),
     lambda p, q, v: (lambda x: quat.multiply(_pure(x), q), v)),
    ("42", "q v by v", "d_qv_d_v", lambda p, q, v: quat.d_qv_d_v(q),
     lambda p, q, v: (lambda x: quat.multiply(q, _pure(x)), v)),
    ("43", "q v q* by v", "d_rotate_d_v", lambda p, q, v: quat.d_rotate_d_v(q),
     lambda p, q, v: (lambda x: _sandwich(q, x), v)),
    ("44, 45", "q* v q by v", "d_rotate_frame_d_v", lambda p, q, v: quat.d_rotate_frame_d_v(q),
     lambda p, q, v: (lambda x: _sandwich(quat.conjugate(q), x), v)),
    ("46", "q v q* by q", "d_rotate_d_q", lambda p, q, v: quat.d_rotate_d_q(q, v),
     lambda p, q, v: (lambda x: _sandwich(x, v), q)),
)  # fmt: skip


def measure_jacobians(rng: np.random.Generator, draws: int = 200) -> tuple[Jacobian, ...]:
    """Compare every Jacobian with central differences at random places."""
    places = [_place(rng) for _ in range(draws)]
    return tuple(
        Jacobian(equation, says, symbol, max(_error(matrix(*place), *problem(*place)) for place in places))
        for equation, says, symbol, matrix, problem in CASES
    )


def _place(rng: np.random.Generator) -> Vectors:
    # The quaternion that rotates has unit length, as in the notes; the other need not.
    return rng.normal(size=4), quat.normalize(rng.normal(size=4)), rng.normal(size=3)


def _error(matrix: FloatArray, function: Function, at: FloatArray) -> float:
    # Polynomials of degree two at most: central differences have no truncation error, only rounding over the step.
    steps = UNIT_STEP * np.eye(at.size)
    columns = [(function(at + step) - function(at - step)) / (2.0 * UNIT_STEP) for step in steps]
    return float(np.abs(matrix - np.stack(columns, axis=-1)).max())


def jacobians_section(jacobians: tuple[Jacobian, ...]) -> Section:
    """Words and table of the comparison."""
    table = Table(
        "jacobians",
        "Jacobians against central differences",
        (Column("equation"), Column("derivative of"), Column("function"), Column("largest error", spec=".1e")),
        tuple((j.equation, j.says, f"quaternion.{j.symbol}", j.error) for j in jacobians),
        f"Rounding in the differences alone leaves about 1e-16 / {short_number(UNIT_STEP)} = 1e-11 for numbers of size "
        "one.",
    )
    return Section(
        "jacobians",
        "Appendix D: Jacobians",
        _finding(jacobians),
        (),
        (table,),
    )


def _finding(jacobians: tuple[Jacobian, ...]) -> str:
    wrong = [j for j in jacobians if not j.error <= DIFFERENCE_ROUNDING]
    if wrong:
        named, most = ", ".join(j.equation for j in wrong), max(j.error for j in wrong)
        return f"Not right by finite differences: {named}. They are off by up to {most:.1e}, far more than rounding."
    return (
        f"All of equations 35 to 46 are right: the largest error against finite differences is "
        f"{max(j.error for j in jacobians):.1e}, which is their rounding."
    )
