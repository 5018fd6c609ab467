"""What to try where a pose was not accepted."""

from __future__ import annotations

import numpy as np

from dqreg.report.numbers_text import text_of
from dqreg.report.story import Story
from dqreg.result import Registration

# Length units that are confused, and the factor between them.
FACTORS = ((1000.0, "m and mm"), (25.4, "inch and mm"), (100.0, "m and cm"), (10.0, "cm and mm"), (304.8, "ft and mm"))


def hints_of(result: Registration, story: Story | None) -> list[str]:
    """What to try where a pose was not accepted."""
    level = result.verdict.level
    hints: list[str] = []
    if level == "accepted":
        return hints
    if story is not None:
        hints += _size_hint(story)
        hints += _distance_hint(story) if level == "failed" else []
    if result.alternatives:
        hints.append("Choose among the alternatives below, in the view and in the list, by a feature that tells them "
                     "apart; then register again with that pose as the start.")  # fmt: skip
    if level == "failed":
        hints.append("Give a start pose from which part and scan overlap (--start FILE), or none, to search for one.")
        reach = text_of(result.settings.get("max_distance"), 4)
        hints.append(f"Raise --max-distance: pairs farther apart than {reach} were not looked at.")
        hints.append("See below where the scan lay before: the wrong part, a mirrored one or much clutter show there.")
    return hints


def _size_hint(story: Story) -> list[str]:
    scan, part = float(np.linalg.norm(np.ptp(story.points, axis=0))), story.size
    ratio = max(scan, part) / max(min(scan, part), np.finfo(float).tiny)
    if ratio < 5.0:
        return []
    sizes = f"The scan is {text_of(scan, 4)} across, the target {text_of(part, 4)} ({text_of(ratio, 3)} to 1)"
    near = [words for factor, words in FACTORS if 0.6 < ratio / factor < 1.7]
    if near:
        return [
            f"{sizes}, which is about what lies between {near[0]}: name the units (--source-units, --target-units)."
        ]
    return [f"{sizes}: cut the scan to the part, or check the units."]


def _distance_hint(story: Story) -> list[str]:
    middle = 0.5 * (story.points.min(axis=0) + story.points.max(axis=0))
    apart = float(np.linalg.norm(middle))
    if apart <= story.size:
        return []
    far = f"{text_of(apart, 4)} {story.unit}"
    return [f"Before, the middle of the scan lay {far} from the target's, which is {text_of(story.size, 4)} across."]
