"""Scan to CAD with no start and no parameter, and a report to hand on.

python examples/from_nothing_report.py                          # the case that ships with dqreg
python examples/from_nothing_report.py scan.ply part.stl 0.05   # your own, with a tolerance in the part's unit
"""

from __future__ import annotations

import sys
from pathlib import Path

import dqreg
from dqreg.synth import demo_case, load_case


def main(arguments: list[str], folder: Path = Path()) -> dqreg.Registration:
    case = load_case(demo_case())
    scan, part, tolerance = arguments or (case.scan, case.part, 0.15)

    result = dqreg.register(scan, part, observe_search=lambda stage: print(f"  {stage.name}: {stage.poses} poses"))
    print(result.verdict.level, *result.verdict.reasons, sep="\n  ")

    report = result.report(folder / "report.html", tolerance=float(tolerance))
    print(f"open {report} in a browser")
    if result.verdict.level != "failed":  # without a pose there is nothing to measure
        within = result.deviations(float(tolerance)).summary().share_within
        print(f"{100 * within:.1f} % of the points lie within {tolerance} of the part")
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]).verdict.level != "accepted")
