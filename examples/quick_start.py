"""The main job in a few lines: a scan, its part, a rough start; the answer and what it rests on.

python examples/quick_start.py
"""

from __future__ import annotations

import dqreg
from dqreg.synth import demo_case, load_case


def main() -> dqreg.Registration:
    case = load_case(demo_case())
    result = dqreg.register(case.scan, case.part, case.T_start, source_units="mm", target_units="mm")
    print(result.verdict.level, *result.verdict.reasons, sep="\n  ")
    print(result.T_target_source)
    for direction in result.observability:
        print(f"{direction.words}: one sigma {direction.sigma:.2g} mm")
    return result


if __name__ == "__main__":
    main()
