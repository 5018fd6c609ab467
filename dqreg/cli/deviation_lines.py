"""The deviations of a result in a few lines, each number with its unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dqreg.inspection import Deviations

# Places worth a line on the screen; the file holds them all.
PLACES = 5


def deviation_lines(deviations: Deviations) -> list[tuple[str, str]]:
    """Names and values to print.

    >>> import numpy as np
    >>> from dqreg.inspection import Deviations
    >>> points, faces = np.zeros((1000, 3)), np.zeros(1000, dtype=np.int64)
    >>> values = np.full(1000, 0.02)
    >>> found = Deviations(values, points, points, faces, True, "positive outside", "mm", tolerance=0.05, apart=2.0)
    >>> for name, text in deviation_lines(found):
    ...     print(f"{name}: {text}")
    deviations: 1000 points; positive outside
    deviation: p50 0.02 mm, p95 0.02 mm, max 0.02 mm; mean +0.02 mm, rms 0.02 mm
    tolerance: +-0.05 mm: 100.00 % within, 0.00 % below, 0.00 % above
    worst: +0.02 mm at (0, 0, 0) mm, 1000 points around it
    """
    unit = deviations.units or "target units"
    summary = deviations.summary()
    counted = f"{summary.count} points"
    if summary.beyond:
        total = summary.count + summary.beyond
        counted = (
            f"{summary.count} of {total} points; the others are farther off than {deviations.reach:.4g} {unit} "
            "and taken for something else (--reach)"
        )
    sign = "+" if deviations.signed else ""
    lines = [("deviations", f"{counted}; {deviations.reason}")]
    if not summary.count:
        return lines
    lines.append(
        (
            "deviation",
            f"p50 {summary.p50:.4g} {unit}, p95 {summary.p95:.4g} {unit}, max {summary.max:.4g} {unit}; "
            f"mean {summary.mean:{sign}.4g} {unit}, rms {summary.rms:.4g} {unit}",
        )
    )
    if deviations.tolerance is not None:
        bands = deviations.bands()
        below = f"{100 * bands.below:.2f} % below, " if deviations.signed else ""
        mark = "+-" if deviations.signed else ""
        lines.append(
            (
                "tolerance",
                f"{mark}{bands.tolerance:g} {unit}: {100 * bands.within:.2f} % within, {below}"
                f"{100 * bands.above:.2f} % above",
            )
        )
    for place in deviations.worst(PLACES):
        where = ", ".join(f"{x:.7g}" for x in place.position)
        lines.append(("worst", f"{place.value:{sign}.4g} {unit} at ({where}) {unit}, {place.points} points around it"))
    return lines
