"""The worked examples of Jia's notes, ours beside theirs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.papers.document import Section
from dqreg.papers.printed import JIA
from dqreg.report.table import Column, Table
from dqreg.rigid import quaternion

# Results that agree do so to this.
AGREEMENT_TOLERANCE = 1e-12
LAST_LINE = "turned i, as the last line prints it"
BEARING_RAD, ELEVATION_RAD = float(np.deg2rad(40.0)), float(np.deg2rad(25.0))


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One printed result."""

    # name, quantity: Where it stands and what it is
    name: str
    quantity: str
    # printed, ours: Both values
    printed: FloatArray
    ours: FloatArray

    @property
    def difference(self) -> float:
        """Largest difference of a component."""
        return float(np.abs(self.printed - self.ours).max())


def measure_examples() -> tuple[Example, ...]:
    """Compute examples 1 to 3."""
    first, second = JIA["example1"], JIA["example2"]
    p, q = np.array(first["p"]), np.array(first["q"])
    third = quaternion.from_axis_angle(second["axis"], np.deg2rad(second["angle_deg"]))
    columns = np.array(second["columns"])
    turned = quaternion.rotate(third, [1, 0, 0])
    return (
        _example("Example 1", "product p q", first["product"], quaternion.multiply(p, q)),
        _example("Example 1", "inner product of the vector parts", first["inner"], [p[1:] @ q[1:]]),
        _example("Example 1", "cross product of the vector parts", first["cross"], np.cross(p[1:], q[1:])),
        _example("Example 2", "quaternion of 120 degrees about (1, 1, 1)", second["q"], third),
        _example("Example 2", "sum of the three columns of eq. 8", columns.sum(axis=0), turned),
        _example("Example 2", LAST_LINE, second["last_line"], turned),
        *_tracking(),
    )


def _tracking() -> tuple[Example, ...]:
    a, b = BEARING_RAD / 2.0, ELEVATION_RAD / 2.0
    about_z = quaternion.from_axis_angle([0, 0, 1], BEARING_RAD)
    both = quaternion.compose_frames(about_z, quaternion.from_axis_angle([0, 1, 0], ELEVATION_RAD))
    axis = [-np.sin(a) * np.sin(b), np.cos(a) * np.sin(b), np.sin(a) * np.cos(b)]
    cosine = (np.cos(2 * a) * np.cos(2 * b) + np.cos(2 * a) + np.cos(2 * b) - 1.0) / 2.0
    angle = quaternion.to_axis_angle(both)[1]
    return (
        _example("Example 3", "axis vector v of eq. 9 (40 and 25 degrees)", axis, both[1:]),
        _example("Example 3", "cos(theta / 2)", [np.cos(a) * np.cos(b)], both[:1]),
        _example("Example 3", "cos(theta)", [cosine], [np.cos(angle)]),
    )


def _example(name: str, quantity: str, printed: ArrayLike, ours: ArrayLike) -> Example:
    return Example(name, quantity, np.asarray(printed, dtype=np.float64), np.asarray(ours, dtype=np.float64))


def examples_section(examples: tuple[Example, ...]) -> Section:
    """Words and table of the examples."""
    table = Table(
        "examples",
        "Printed results and ours",
        (Column("where"), Column("what"), Column("printed"), Column("ours"), Column("difference", spec=".1e")),
        tuple((e.name, e.quantity, _words(e.printed), _words(e.ours), e.difference) for e in examples),
        "Quaternions scalar first. Example 3 is printed in letters; they are evaluated at a bearing of 40 and an "
        "elevation of 25 degrees.",
    )
    return Section(
        "examples",
        "Worked examples 1 to 3",
        _finding(examples),
        (),
        (table,),
    )


def _finding(examples: tuple[Example, ...]) -> str:
    wrong = [e for e in examples if not e.difference < AGREEMENT_TOLERANCE]
    words = [f"{len(examples) - len(wrong)} of {len(examples)} printed results agree to rounding."]
    if others := [e for e in wrong if e.quantity != LAST_LINE]:
        named = "; ".join(f"{e.name}, {e.quantity} (off by {e.difference:.1e})" for e in others)
        words.append(f"These do not: {named}.")
    if any(e.quantity == LAST_LINE for e in wrong):
        words.append(
            "The last line of example 2 in the text at hand does not: it prints i, while the three columns that it "
            "adds up give (0, 1, 0), that is j."
        )
    return " ".join(words)


def _words(vector: FloatArray) -> str:
    numbers = ", ".join(f"{value + 0.0:.6g}" for value in np.round(vector, 12))
    return f"({numbers})" if vector.size > 1 else numbers
