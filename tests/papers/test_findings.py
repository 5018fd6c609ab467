"""Headlines follow from the numbers: each section is fed a true and a false measurement, and its sentence turns."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from dqreg.papers.accuracy import METHODS, Outcome, accuracy_section
from dqreg.papers.convergence import Path, convergence_section
from dqreg.papers.directions import SIGMA_RATIOS, Gain, directions_section
from dqreg.papers.examples import examples_section, measure_examples
from dqreg.papers.integration import Order, integration_section
from dqreg.papers.interpolation import Between, interpolation_section
from dqreg.papers.jacobians import Jacobian, jacobians_section
from dqreg.papers.registration import HornRow, registration_section
from dqreg.papers.simulation import Accuracy
from dqreg.papers.solution_time import Timing, time_section
from dqreg.papers.table3 import COUNTS, Row3, table3_section
from dqreg.papers.weights import NOISE_RATIOS, WEIGHINGS, Loss, weights_section
from dqreg.report.table import Estimate


def estimates(*values, error=0.01):
    return tuple(Estimate(value, error) for value in values)


def says(section, *phrases, without=()):
    for phrase in phrases:
        assert phrase in section.finding
    for phrase in without:
        assert phrase not in section.finding


def table3(shift, turn):
    four = estimates(0.4, 0.5, 0.3, 0.2)
    rows = [
        Row3(n, dict.fromkeys(("svd", "walker1991", "solve"), four), four, np.ones(4), (shift, turn)) for n in COUNTS
    ]
    return table3_section(tuple(rows))


def test_table_3():
    says(table3(4e-13, 6e-15), "cannot be repeated", "which is rounding")
    for apart in ((5.0, 0.1), (5.0, 0.0), (0.0, 0.1), (np.nan, 0.0)):
        says(table3(*apart), "do not agree", without=["which is rounding", "cannot be repeated"])


def time(r_squared, slope=1e-7):
    return time_section((Timing("solve", (3, 10), (1e-4, 1e-4), slope, 1e-4, r_squared),))


def test_time():
    says(time(0.999), "as the paper says (O(n))", "100 ns a sample")
    says(time(0.0), "do not show the line", "R squared 0.000", without=["as the paper says", "ns a sample"])
    says(time(0.999, slope=-1e-7), "do not show the line")
    says(time(np.nan), "do not show the line")


def losses(likely=1.0, others=1.2, metres=3.0):
    known = dict.fromkeys(WEIGHINGS, others) | {"likelihood": likely, "alpha = beta = 1, in m": metres}
    return tuple(
        Loss(name, float(ratio), *estimates(value, value), value, value)
        for name, value in known.items()
        for ratio in NOISE_RATIOS
    )


def test_weights():
    good = weights_section(losses())
    says(good, "Take beta = 1", "reach the Cramer-Rao bound at every ratio", "nothing beats", "unit of length")
    says(weights_section(losses(likely=3.0)), "miss the Cramer-Rao bound at 13 of 13", "3.000 times", without=["reach"])
    says(weights_section(losses(others=0.5)), "lie below the bound", "wrong", without=["nothing beats", "Take beta"])
    says(weights_section(losses(metres=1.2)), without=["unit of length"])


def gains(bare=0.7, helped=0.03, equal=0.69, lone=0.014):
    def gain(points, directions, ratio):
        value = {(3, 0): bare, (3, 2): helped, (1, 2): lone}.get((points, directions), 0.1)
        likely, same = (Accuracy(*estimates(v, v, error=0.001)) for v in (value, equal))
        return Gain(points, directions, ratio, likely, same, (value, value))

    return tuple(gain(p, d, r) for p in (1, 3, 5) for d in (0, 1, 2, 5, 10) for r in SIGMA_RATIOS if p >= 3 or d >= 2)


def test_directions():
    says(directions_section(gains()), "from 0.700 to 0.030", "alpha = beta = 1 it is 0.690", "One point is enough")
    says(directions_section(gains(helped=0.7)), "do not help", without=["bring"])
    says(directions_section(gains(equal=0.03)), "alpha = beta = 1 is as good")
    for lone in (90.0, np.nan):
        says(directions_section(gains(lone=lone)), "One point is not enough")


LAYOUTS = {
    "at the origin": 2e-16,
    "a million sizes away": 2e-10,
    "strip along the axes, width 1e-5 of the length": 2e-11,
    "strip in general position, width 1e-5 of the length": 2e-11,
    "strip along the axes, exactly on a line": np.inf,
    "one point, repeated": np.inf,
}


def accuracy(worst=None, refused=None, **per_layout):
    outcomes = []
    for layout, floor in LAYOUTS.items():
        free = not np.isfinite(floor)
        errors = dict.fromkeys(METHODS, np.nan if free else floor)
        counts = dict.fromkeys(METHODS, 5 if free else 0)
        errors |= (worst or {}).get(layout, {})
        counts |= (refused or {}).get(layout, {})
        outcomes.append(Outcome(layout, "axes" in layout, floor, errors, counts, 5))
    return accuracy_section(tuple(outcomes))


def test_accuracy():
    says(accuracy(), "all four are exact to rounding", "solve errs by 2e-10 rad, as little as", "refused by all")
    wrong = accuracy(
        {name: dict.fromkeys(METHODS, 0.5) for name in LAYOUTS}, {name: dict.fromkeys(METHODS, 0) for name in LAYOUTS}
    )
    says(wrong, "more than rounding", "solve errs by 5e-1 rad", "give a pose, though their rotation is free")
    says(wrong, without=["exact to rounding", "as little as", "never answered"])
    lost = accuracy(refused={"a million sizes away": {"walker1991": 5}})
    says(lost, "walker1991 has lost its digits and is refused")
    narrow = "strip along the axes, width 1e-5 of the length"
    assert (
        "Strip along the axes: the digits of the data are kept at every width by solve, walker1991, svd, horn"
        in accuracy().text[1]
    )
    assert "solve at 0 of 1" in accuracy({narrow: {"solve": 4e-6}}).text[1]
    assert "horn at 0 of 1" in accuracy(refused={narrow: {"horn": 1}}).text[1]


def test_jacobians():
    good = tuple(Jacobian(str(n), "", "", 1e-11) for n in range(35, 47))
    says(jacobians_section(good), "All of equations 35 to 46 are right", "rounding")
    for error in (0.7, np.nan):
        bad = (*good[:3], replace(good[3], error=error), *good[4:])
        says(
            jacobians_section(bad),
            "Not right by finite differences: 38.",
            without=["All of", "which is their rounding"],
        )


def test_examples():
    found = measure_examples()
    says(examples_section(found), f"{len(found) - 1} of {len(found)}", "The last line of example 2")
    repaired = tuple(replace(e, printed=e.ours) for e in found)
    says(examples_section(repaired), f"{len(found)} of {len(found)}", without=["does not"])
    broken = (replace(found[0], ours=found[0].ours + 1), *found[1:])
    says(examples_section(broken), f"{len(found) - 2} of", "These do not: Example 1, product p q (off by 1.0e+00)")


def horn(ratio):
    row = HornRow(1e-3, *estimates(ratio, ratio), (1.0, 1.0))
    return registration_section((HornRow(0.0, *estimates(1e-16, 1e-16, error=0), (0.0, 0.0)), row))


def test_registration():
    says(horn(1.0), "is as exact as the noise allows")
    says(horn(3.0), "is not as exact", "3.00 times")
    says(horn(0.5), "below the Cramer-Rao bound", "wrong", without=["as exact"])


def orders(*slopes):
    return tuple(Order(f"m{i}", (1, 4)[i], slope, (0.1, 0.2), (0.1, 0.2)) for i, slope in enumerate(slopes))


def test_integration():
    says(integration_section(orders(0.99, 4.02)), "as by theory")
    for slopes in ((0.99, 1.0), (0.1, 4.0), (np.nan, 4.0)):
        says(integration_section(orders(*slopes)), "does not show", without=["as by theory"])


def between(low, high, count=11):
    speed = np.linspace(low, high, count)
    return Between("", np.linspace(0, 1, count), speed, np.ones((count, 3)), speed)


def test_interpolation():
    good = interpolation_section((between(100, 150), between(110, 110)))
    says(good, "Equation 33 does not turn the body evenly", "Slerp turns the body evenly", "the less of the two")
    bad = interpolation_section((between(100, 100), between(50, 200)))
    says(bad, "Equation 33 turns the body evenly", "Slerp does not", "no less than equation 33")


def test_icp():
    def path(count, error):
        return Path("", "converged", (*np.full(count - 1, 0.05), error), tuple(np.full(count, 1e-3)))

    good = convergence_section((path(30, 2e-4), path(12, 2e-4), path(30, 2e-4)))
    says(good, "The notes' ICP ends within 2.0e-4", "12 iterations (converged), fewer", "as many")
    bad = convergence_section((path(30, 0.3), path(40, 2e-4), path(12, 0.2)))
    says(bad, "stops 3.0e-1 of the size away", "40 iterations (converged), more")


def test_every_section_of_both_papers_is_here():
    asked = {name for name in vars(sys.modules["dqreg.papers.reproduce"]) if name.endswith("_section")}
    assert len(asked) == 11
    assert asked <= set(globals())
