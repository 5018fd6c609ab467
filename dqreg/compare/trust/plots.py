"""The reliability diagram of the confidence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dqreg.compare.plots import Plot
from dqreg.compare.trust.calibration import Calibration
from dqreg.report.figure import PALETTE, encode, stacked

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INCHES, DOTS = 5.0, 150


def reliability_plot(found: Calibration) -> Plot:
    """Fraction of right poses over the confidence, with 95 % intervals, and how many tasks each bin has."""

    def diagram(axes: Axes) -> None:
        x, y = [one.confidence for one in found.bins], [one.right for one in found.bins]
        below = [one.right - one.right_low for one in found.bins]
        above = [one.right_high - one.right for one in found.bins]
        axes.plot([0, 1], [0, 1], color=PALETTE[6], linestyle=":", label="perfect")
        axes.errorbar(x, y, yerr=[below, above], fmt="o-", color=PALETTE[0], capsize=3, label="measured, 95 %")
        axes.set_xlim(-0.02, 1.02)
        axes.set_ylim(-0.02, 1.02)
        axes.set_ylabel("fraction of right poses")
        axes.legend(loc="upper left")

    def counts(axes: Axes) -> None:
        axes.bar([0.5 * (one.low + one.high) for one in found.bins], [one.trials for one in found.bins],
                 width=0.09, color=PALETTE[5])  # fmt: skip
        axes.set_xlim(-0.02, 1.02)
        axes.set_xlabel("confidence of the verdict")
        axes.set_ylabel("tasks")

    figure, _ = stacked((diagram, counts), INCHES, (4.0, 1.4), DOTS)
    title = "Reliability: how often poses of a given confidence are right"
    return Plot("reliability", title, encode(figure))
