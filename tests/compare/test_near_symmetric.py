from __future__ import annotations

from pathlib import Path

import numpy as np

from dqreg.compare.judge import judge
from dqreg.compare.plan import from_case
from dqreg.synth import load_case

# Generated cases that come with the repository; the truths are in their truth.json.
CASES = Path(__file__).parents[2] / "datasets_synth"
BLOCK, PRISM = CASES / "block_light", CASES / "prism_camera"


def test_a_block_that_lacks_a_corner_has_one_truth_and_its_flips_are_wrong() -> None:
    truth = load_case(BLOCK).truth
    known = from_case(BLOCK).ground_truth
    assert judge(np.array(truth["T_target_source"]), known).success
    flips = np.array(truth["near_symmetric_truths"])
    # Three half-turns put a block onto itself, but for the corner.
    assert len(flips) == 3
    for flip in flips:
        score = judge(flip, known)
        assert not score.success
        # The surface alone could not tell: nearly all of the held-out points lie on it. The vertices do.
        assert score.worst > 0.5 * known.size


def test_a_prism_has_as_many_truths_as_symmetries() -> None:
    truth = load_case(PRISM).truth
    known = from_case(PRISM).ground_truth
    assert len(truth["symmetric_truths"]) == 12
    assert all(judge(np.array(T), known).success for T in truth["symmetric_truths"])
