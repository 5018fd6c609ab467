"""What to try where a pose was not accepted: on the page and on the screen."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import bounds
from dqreg.files.side_digests import CHANGED
from dqreg.files.units import MIXED, MIXED_RARELY, factor
from dqreg.geometry import Mesh
from dqreg.report.result_protocol import RegisteredPair, RegistrationResult
from dqreg.report.text import text_of, unit_words
from dqreg.trust.code_sets import OF_A_DEVIATING_PART

# Sizes that differ by more than that factor are worth a word, and those within these bounds of a unit's factor; of
# smaller factors, by which many a view is smaller than its part, within these.
APART_RATIO, NEAR_RATIOS = 5.0, (0.6, 1.7)
NEAR_SMALL_RATIOS = 0.8, 1.25


def hints_of(result: RegistrationResult) -> list[str]:
    """Sentences, the likeliest cause first; none for a pose that was accepted."""
    level = result.verdict.level
    hints: list[str] = []
    if level == "accepted":
        return hints
    if result.inputs is not None:
        hints += _sides_hint(result.inputs)
        hints += _size_hint(result, result.inputs)
        hints += _distance_hint(result, result.inputs) if level == "failed" else []
        hints += _deviation_hint(result, result.inputs)
    if result.alternatives:
        hints.append("Choose among the alternatives by a feature that distinguishes them; then register again with "
                     "that pose as the initial pose: --start result.json#2 for the second.")  # fmt: skip
    if level == "failed":
        hints.append("Give an initial pose at which part and scan overlap (--start FILE), or none for a global search.")
        reach = text_of(result.settings.get("max_distance"), 4)
        hints.append(f"Raise --max-distance: correspondences farther apart than {reach} are rejected.")
        hints.append("Look where the scan lay before: the wrong part, a mirrored one or much clutter show there.")
    return hints


def remarks_of(result: RegistrationResult) -> list[str]:
    """What a person should know beside the verdict: that the files are others now; of a pose that was accepted more."""
    changed = [f"{words}."] if (words := result.settings.get(CHANGED)) else []
    if result.verdict.level != "accepted" or result.inputs is None or not is_mesh_on_cloud(result.inputs):
        return changed
    return [
        *changed,
        "The first file is a mesh and the second a cloud of points: the pose maps the mesh to the cloud. The usual "
        "order is the scan first, then the part.",
    ]


def is_mesh_on_cloud(inputs: RegisteredPair) -> bool:
    """Whether a mesh was laid on a cloud of points, as where the part is named first."""
    return inputs.source.mesh is not None and not isinstance(inputs.target.geometry, Mesh)


def _sides_hint(inputs: RegisteredPair) -> list[str]:
    if not is_mesh_on_cloud(inputs):
        return []
    return ["The first file is a mesh and the second a cloud of points: if the first is the part, swap them."]


def _deviation_hint(result: RegistrationResult, inputs: RegisteredPair) -> list[str]:
    if not isinstance(inputs.target.geometry, Mesh) or not OF_A_DEVIATING_PART.issuperset(result.verdict.codes):
        return []
    return [
        "If it is this part at this pose, and only off its model by more than made parts are, as a casting: say by how "
        "much it may be, with --expected-deviation LENGTH or in the plan."
    ]


def _size_hint(result: RegistrationResult, inputs: RegisteredPair) -> list[str]:
    scan = float(np.linalg.norm(np.subtract(*bounds(inputs.source.cloud.points))))
    part = inputs.target.surface.diagonal
    ratio = max(scan, part) / max(min(scan, part), np.finfo(float).tiny)
    near = _units_near(ratio)
    if ratio < APART_RATIO and not near:
        return []
    sizes = f"The scan is {text_of(scan, 4)} across, the target {text_of(part, 4)} ({text_of(ratio, 3)} to 1)"
    if not near:
        return [f"{sizes}: cut the scan to the part, or check the units."]
    named = [result.settings.get(name) for name in ("source_units", "target_units")]
    if all(named):
        words = f"although they are named {named[0]} and {named[1]}: one of these may be wrong"
        return [f"{sizes}, close to the ratio of {near[0]}, {words} (--source-units, --target-units)."]
    return [
        f"{sizes}, close to the ratio of {' or of '.join(near[:2])}: name the units (--source-units, --target-units)."
    ]


def _units_near(ratio: float) -> list[str]:
    """Pairs of units whose ratio explains one of sizes, those that are confused most often first.

    >>> _units_near(11.5), _units_near(3.2), _units_near(1.4)
    (['cm and mm', 'ft and inch'], ['m and ft'], [])
    """
    pairs = [(coarse, fine, factor(coarse, fine)) for coarse, fine in (*MIXED, *MIXED_RARELY)]
    within = [(*pair, NEAR_RATIOS if pair[2] > APART_RATIO else NEAR_SMALL_RATIOS) for pair in pairs]
    return [f"{coarse} and {fine}" for coarse, fine, units, (low, high) in within if low < ratio / units < high]


def _distance_hint(result: RegistrationResult, inputs: RegisteredPair) -> list[str]:
    start = result.settings.get("T_start")
    points = inputs.placed(np.eye(4) if start is None else np.array(start))
    apart = float(np.linalg.norm(0.5 * np.add(*bounds(points))))
    size = inputs.target.surface.diagonal
    if apart <= size:
        return []
    unit = unit_words(result.settings.get("target_units"))
    return [
        f"Before, the centre of the scan lay {text_of(apart, 4)}{unit} from the target's centre; the target is "
        f"{text_of(size, 4)} across."
    ]
