from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from dqreg.registration.result.result import Alternative, Direction
from dqreg.trust import Evidence, judge, limits
from dqreg.trust.verdict import QUESTIONS, UNLIKELY

NAN, INF = float("nan"), float("inf")
HELD = Direction(0.1, 0.01, "translation along (1.00, 0.00, 0.00)")
FREE = Direction(0.0, NAN, "unconstrained: translation along (0.00, 0.00, 1.00)")
ROTATION = Direction(0.1, 1.0, "rotation about z", "rotation")
SHIFT = Direction(0.1, 1.0, "translation along z", "translation")
GOOD = Evidence(
    status="converged",
    found=True,
    inliers=1_000.0,
    share_near=0.95,
    near=2.0,
    patches=300,
    patches_off=0.01,
    strays=0.1,
    normals_apart=0.02,
    width=0.01,
    expected=0.01,
    max_distance=20.0,
    directions=(HELD,) * 6,
    alternatives=(),
)
# Each cause, and the one sentence that it brings.
CAUSES: dict[str, tuple[dict[str, Any], str, str]] = {
    "half in the air": (
        {"share_on": 0.839, "is_scene": False},
        "16 % of the scan are off the target, which is no smaller than the scan",
        "clutter",
    ),
    "among strays": ({"share_on": 0.649, "is_scene": False, "strays": 0.3}, "35 % of the scan are off", "clutter"),
    "few points": ({"inliers": limits.MIN_INLIERS - 1.0}, "only 29 inliers", "few_inliers"),
    "unknown points": ({"inliers": NAN}, "only nan inliers", "few_inliers"),
    "clutter": (
        {"share_near": limits.MIN_INLIER_FRACTION - 0.01},
        "% of the points within 2 of the target",
        "low_inlier_fraction",
    ),
    "unknown share": ({"share_near": NAN}, "% of the points within 2 of the target", "low_inlier_fraction"),
    "rough": (
        {"width": 1.1 * limits.RESIDUAL_NOISE_RATIO * 0.01},
        "the shapes differ, or the pose is wrong",
        "large_residuals",
    ),
    "unknown width": ({"width": NAN}, "the shapes differ, or the pose is wrong", "large_residuals"),
    "patches": (
        {"patches_off": limits.DEVIATING_PATCH_SHARE + 0.08},
        "11 % of the patches of points within 2 of the target deviate as a whole",
        "deviating_patches",
    ),
    # 180 mm of a block 18 mm longer than its part: a sixth of the scan, sparse as strays but side by side.
    "patches among strays that lie beside each other": (
        {"patches_off": 0.052, "strays": 0.15, "share_together": 0.1},
        "deviate as a whole",
        "deviating_patches",
    ),
    "unknown patches": ({"patches_off": NAN}, "deviate as a whole", "deviating_patches"),
    "more than the part": (
        {"share_on": 0.7, "share_contradicting": 0.1},
        "10 % of the scan are faces that continue beyond the target",
        "contradicting_surface",
    ),
    # Of a sparse scan few points are on smooth surface; those off it are held against those on it.
    "more than the part, sparse": (
        {"share_on": 0.7, "share_contradicting": 0.04, "share_on_faces": 0.28},
        "4 % of the scan are faces that continue beyond the target",
        "contradicting_surface",
    ),
    "not the part alone": (
        {"share_on": 0.94, "share_other": 0.06, "clutter": "none"},
        "6 % of the scan are off the target, which it is said to show alone",
        "clutter",
    ),
    "looked through": (
        {"looked_through": 0.18},
        "18 % of the points compared stand where a scanner looked through",
        "looked_through",
    ),
    "rays passed": (
        {"looked_through": limits.RAY_CONFLICT_SHARE + 0.005, "seen_alike": 0.6},
        "4 % of the points compared stand where a scanner looked through",
        "looked_through",
    ),
    "faces apart": (
        {"faces_apart": limits.FACES_APART_SHARE + 0.01},
        "4 % of the places that both scans show lie apart",
        "faces_apart",
    ),
    "ends apart": (
        {"ends_apart": limits.FACE_OVERHANG_SHARE + 0.01},
        "5 % of each and more lie beyond the other's",
        "ends_apart",
    ),
    "ends apart among shared rims": (
        {
            "ends_apart": limits.FACE_OVERHANG_SHARE_WITH_RIMS + 0.01,
            "rims_shared": limits.OVERHANG_SHARED_RIMS,
            "largest_plane": 0.5,
        },
        "13 % of each and more lie beyond the other's",
        "ends_apart",
    ),
    "rims apart": (
        {"rims_shared": limits.SHARED_RIM_SHARE - 0.01, "largest_plane": 0.5},
        "59 % of the rims of one are rims of the other",
        "rims_apart",
    ),
    "rims apart, in more planes than a corner's": (
        {"rims_shared": limits.SHARED_RIM_SHARE_OF_MANY_PLANES - 0.01},
        "11 % of the rims of one are rims of the other",
        "rims_apart",
    ),
    "rims apart, of scans with little in common": (
        {"rims_shared": limits.SHARED_RIM_SHARE_OF_LITTLE - 0.01, "_common": limits.LITTLE_COMMON_SHARE - 0.01},
        "49 % of the rims of one are rims of the other",
        "rims_apart",
    ),
    "rims elsewhere": (
        {"rims_elsewhere": (limits.RIM_GAIN_SHARE + 0.01, 3.2)},
        "slide by 3.2 16 % more of the rims of one are rims of the other",
        "rims_elsewhere",
    ),
    "opposed edges": (
        {"opposed_edges": limits.OPPOSED_EDGE_SHARE + 0.1},
        "beside 50 % of the rims that both scans show in one plane the faces turn to opposite sides",
        "opposed_edges",
    ),
    "closed hole": (
        {"closed_hole": 0.04, "size": 1.0},
        "a hole 0.04 wide in a face of one scan is closed in the other",
        "closed_hole",
    ),
    "one plane": (
        {"largest_plane": limits.ONE_PLANE_SHARE + 0.005},
        "99 % of what both scans show lie in one plane",
        "one_plane",
    ),
    "deformed": (
        {"deformation": 0.003, "size": 1.0},
        "a deformation displaces the surface of the scan by 0.003 (0.3 % of the size, root mean square)",
        "deformed",
    ),
    "normals": (
        {"normals_apart": limits.DISAGREEING_NORMAL_SHARE + 0.01},
        "16 % of the inliers have normals that disagree with the target: a local minimum, another part, or normals "
        "that were given without a side",
        "disagreeing_normals",
    ),
    "strays": ({"strays": limits.OUTLIER_SHARE + 0.01}, "51 % of all points are outliers", "outliers"),
    "on no surface": ({"share_on": 0.13, "share_other": 0.01}, "86 % of all points are outliers", "outliers"),
    "no time": (
        {"search": "refined"},
        'the time limit ended the global search after its stage "refined"',
        "search_time_limit",
    ),
    "free": ({"directions": (FREE, *(HELD,) * 5)}, FREE.words, "unconstrained"),
    "ambiguous": (
        {"alternatives": (Alternative(np.eye(4), 0.1),)},
        "another pose is equally likely",
        "alternative_poses",
    ),
    "stopped": (
        {"status": "iteration limit"},
        "ICP did not converge: iteration limit; raise max_iterations",
        "not_converged",
    ),
    "stalled": ({"status": "stalled"}, "the step size stopped decreasing: check the pose", "not_converged"),
    "too long": (
        {"stretch": 0.034, "stretched_along": (1.0, -0.001, 0.0)},
        "the scan is 3.4 % too long along (1.00, 0.00, 0.00)",
        "stretched",
    ),
    "too small": ({"stretch": -0.01}, "the scan is 1 % too small: a part that shrank", "stretched"),
    "drift": (
        {"drift": 1.7, "drift_rad": math.radians(0.8)},
        "the pose drifts by 1.7 and 0.8 degrees within the scan",
        "drift",
    ),
    "a detail with another feature": (
        {"share_together": 0.013, "is_detail": True},
        "the scan shows a detail of the target, and 1.3 % of it lie beside each other off the target",
        "local_difference",
    ),
    "wavy": (
        {"waviness": 1.01 * limits.WAVINESS_DIAGONALS * 100.0, "size": 100.0},
        "neighbouring points deviate together, by 0.151 (0.15 % of the size, one sigma)",
        "wavy",
    ),
    "bent": ({"bend": 0.004}, "the scan is bent or twisted by 0.4 % of its length", "bent"),
    "few of all": (
        {"share_near": limits.MIN_FRACTION_OF_ALL - 0.01, "near": INF},
        "only 49 % of the points are inliers",
        "low_inlier_fraction",
    ),
    "fewer than before": (
        {"share_near": 0.6, "near": INF, "usual": 0.9},
        "60 % of the points are inliers, after 90 % in the frames before",
        "falling_inlier_fraction",
    ),
    "chance": (
        {"random_ratio": limits.CHANCE_RATIO + 0.01},
        "the residuals are 26 % of those at random poses",
        "random_fit",
    ),
    "chance with a quarter on": (
        {"random_ratio": 0.5 * limits.CHANCE_RATIO + 0.01, "share_on": 0.25, "share_other": 0.75},
        "the residuals are 14 % of those at random poses",
        "random_fit",
    ),
    "unknown chance": ({"random_ratio": NAN}, "of those at random poses", "random_fit"),
    "uncertain rotation": (
        {"directions": (ROTATION, *(HELD,) * 5), "size": 1.99 * 1.0 / math.radians(2.0)},
        "the pose is uncertain by 1 (one sigma, 2 % of the size): rotation about z",
        "large_uncertainty",
    ),
    "uncertain translation": (
        {"directions": (SHIFT, *(HELD,) * 5), "size": 49.0},
        "the pose is uncertain by 1 (one sigma, 2 % of the size): translation along z",
        "large_uncertainty",
    ),
    "held by a detail": (
        {"directions": (HELD,) * 6, "carriers": (4.0, *(500.0,) * 5)},
        "one motion depends on about 4 points: translation along (1.00, 0.00, 0.00)",
        "weakly_constrained",
    ),
    "slides": (
        {
            "directions": (HELD,) * 6,
            "carriers": (4.0, *(500.0,) * 5),
            "sliding_loss": limits.CONSTRAINT_LOG_LIKELIHOOD - 0.1,
        },
        "one motion depends on about 4 points: translation along (1.00, 0.00, 0.00)",
        "weakly_constrained",
    ),
    "mirrored": ({"mirror_gain": 0.1}, "the scan fits better when mirrored", "mirrored"),
    "held away": (
        {"mirror_gain": 0.1, "freed_gain": 0.3, "freed_rad": 0.05, "freed_shift": 1.25},
        "after a rotation by 2.9 degrees and a shift by 1.25 of the middle, which dof= or prior= forbids",
        "forbidden_motion",
    ),
    "too short": (
        {"stretch": -0.1, "stretched_along": (0.0, 0.0, 1.0)},
        "10 % too short along (0.00, 0.00, 1.00)",
        "stretched",
    ),
}


def test_nothing_against_it_is_accepted_and_says_why() -> None:
    verdict = judge(GOOD)
    assert verdict.level == "accepted"
    assert verdict.reasons == (
        "1000 inliers with residuals of 0.01 (one sigma), 95 % of the points within 2 of the target; all degrees of "
        "freedom are constrained",
    )


def test_what_an_accepted_pose_leaves_open_is_remarked_and_is_no_doubt() -> None:
    verdict = judge(dataclasses.replace(GOOD, share_together=0.023, ends_apart=0.0, largest_plane=0.5))
    assert verdict.level == "accepted"
    assert verdict.codes == ("accepted", "local_difference", "scale_unobservable")
    assert "2.3 % of the points near the target lie beside each other off it" in verdict.reasons[1]
    assert "whether one is scaled, mirrored, or stretched along an edge, cannot be told" in verdict.reasons[2]
    # A doubt is not watered down by remarks.
    assert judge(dataclasses.replace(GOOD, share_together=0.023, share_near=0.1)).codes == ("low_inlier_fraction",)


def test_a_symmetry_of_the_part_is_said_and_is_no_doubt() -> None:
    other = Alternative(np.eye(4), 0.1, "the part looks the same after a rotation of 180 degrees about the axis z")
    verdict = judge(dataclasses.replace(GOOD, alternatives=(other, other)))
    assert verdict.level == "accepted"
    assert verdict.reasons[0].count(other.symmetry) == 1
    # One that is more than symmetry is a doubt, and only that one counts.
    mixed = judge(dataclasses.replace(GOOD, alternatives=(other, Alternative(np.eye(4), 0.1))))
    assert mixed.level == "suspect"
    assert mixed.reasons[0].startswith("another pose is")


@pytest.mark.parametrize("changes", [{"share_near": 0.1}, {"share_near": 0.1, "viewpoint_behind": 0.3}, {"drift": 1.0}])
def test_a_symmetry_of_the_part_is_said_of_a_pose_in_doubt_too(changes: dict[str, float]) -> None:
    # What is measured may be on another face than the one that it is named after.
    other = Alternative(np.eye(4), 0.1, "the part looks the same after a half-turn")
    plain, symmetric = (
        judge(dataclasses.replace(GOOD, alternatives=found, **changes))  # type: ignore[arg-type]
        for found in ((), (other, other))
    )
    assert (symmetric.level, symmetric.codes) == (plain.level, plain.codes) == ("suspect", plain.codes)
    assert (
        symmetric.reasons[-1] == f"{plain.reasons[-1]}; {other.symmetry}, so the pose is one of several equivalent ones"
    )


@pytest.mark.parametrize("cause", CAUSES)
def test_a_doubt_appears_with_its_cause_and_alone(cause: str) -> None:
    changes, sentence, code = CAUSES[cause]
    verdict = judge(dataclasses.replace(GOOD, **changes))
    assert verdict.level == "suspect"
    assert verdict.codes == (code,)
    assert sentence in verdict.reasons[0]


def test_every_doubt_is_provoked_by_a_cause() -> None:
    assert {code for _, _, code in CAUSES.values()} == {question.code for question in QUESTIONS}


@pytest.mark.parametrize(
    "changes",
    [
        {"inliers": float(limits.MIN_INLIERS)},
        {"share_near": limits.MIN_INLIER_FRACTION},
        {"share_near": limits.MIN_FRACTION_OF_ALL, "near": INF},
        {"share_near": limits.MIN_RATIO_TO_EARLIER * 0.9, "near": INF, "usual": 0.9},
        {"width": 0.99 * limits.RESIDUAL_NOISE_RATIO * 0.01},
        {"patches_off": limits.DEVIATING_PATCH_SHARE_AT_BORDER, "has_border": True},
        {"patches_off": limits.DEVIATING_PATCH_SHARE, "strays": 0.0},
        {"patches_off": limits.DEVIATING_PATCH_SHARE + limits.DEVIATING_PATCHES_PER_OUTLIER * 0.2, "strays": 0.2},
        {
            "patches_off": limits.DEVIATING_PATCH_SHARE,
            "normals_apart": limits.DISAGREEING_NORMAL_SHARE,
            "strays": limits.OUTLIER_SHARE,
        },
        {"search": "judged"},
        {"alternatives": (Alternative(np.eye(4), 0.1, "the part looks the same after a half-turn"),)},
        {"width": 0.0},
        {"random_ratio": limits.CHANCE_RATIO},
        {"random_ratio": 0.5 * limits.CHANCE_RATIO, "share_on": 0.25, "share_other": 0.75},
        # A table beside the part, and a scan of the part alone.
        {"share_on": 0.1, "share_other": 0.9},
        {"share_on": 0.88, "share_contradicting": 0.12},
        {"share_on": 0.7, "share_contradicting": 0.06, "share_on_faces": 0.44},
        {"share_on": 0.3},
        {"share_on": 0.95, "clutter": "none"},
        # GOOD has a tenth of strays; among many the rest is not told from them.
        {"share_on": 0.841, "is_scene": False},
        {"share_on": 0.651, "is_scene": False, "strays": 0.3},
        {"looked_through": 0.05},
        {"looked_through": limits.RAY_CONFLICT_SHARE, "seen_alike": 0.6},
        {"ends_apart": limits.FACE_OVERHANG_SHARE},
        # A room before a LiDAR: what it saw from either place ends elsewhere, some of the rims are the same.
        {"ends_apart": 0.26, "rims_shared": 0.21, "_common": limits.LITTLE_COMMON_SHARE},
        {"rims_shared": limits.SHARED_RIM_SHARE_OF_LITTLE, "_common": 0.2},
        {"closed_hole": 0.012, "size": 1.0},
        {"ends_apart": limits.FACE_OVERHANG_SHARE_WITH_RIMS, "rims_shared": limits.OVERHANG_SHARED_RIMS},
        {"directions": (ROTATION,) * 6, "size": 2.01 / math.radians(2.0)},
        {"directions": (SHIFT,) * 6, "size": 50.1},
        # Few of few, as of a tactile scan, and few of many that are enough.
        {"inliers": 60.0, "carriers": (4.0,) * 6},
        {"inliers": 1e6, "carriers": (30.0,) * 6},
        {"directions": (HELD,) * 6, "carriers": (4.0, *(500.0,) * 5), "sliding_loss": limits.CONSTRAINT_LOG_LIKELIHOOD},
        {"expected": 0.0},
    ],
)
def test_at_the_limit_there_is_no_doubt(changes: dict[str, Any]) -> None:
    # All figures together may still speak against it, and three common planes know no scale.
    harmless = {"accepted", "low_confidence", "scale_unobservable"}
    assert set(judge(dataclasses.replace(GOOD, **changes)).codes) <= harmless


def test_all_figures_together_may_speak_against_a_pose() -> None:
    # Each of them is within its limit.
    weak = {"inliers": 200.0, "width": 0.03, "random_ratio": 0.2, "directions": (SHIFT,) * 6, "size": 51.0}
    verdict = judge(dataclasses.replace(GOOD, **weak))
    assert verdict.codes == ("low_confidence",)
    assert verdict.confidence < UNLIKELY
    assert judge(dataclasses.replace(GOOD, **{**weak, "size": NAN})).level == "accepted"


def test_fewer_inliers_are_compared_with_chance_more_strictly() -> None:
    ratio = limits.CHANCE_RATIO * 0.5
    at = {count: judge(dataclasses.replace(GOOD, random_ratio=ratio, inliers=count)).codes for count in (99.0, 101.0)}
    assert at == {99.0: ("random_fit",), 101.0: ("accepted",)}


def test_waves_between_clouds_have_a_limit_of_their_own() -> None:
    waves = {"size": 1.0, "waviness": 2.0 * limits.WAVINESS_DIAGONALS_OF_CLOUDS}
    assert judge(dataclasses.replace(GOOD, **waves)).codes == ("accepted",)
    assert judge(dataclasses.replace(GOOD, faces_apart=0.0, **waves)).codes == ("wavy",)


def test_all_doubts_stand_side_by_side_and_each_free_motion_for_itself() -> None:
    changes: dict[str, Any] = {
        "inliers": 10.0,
        "share_near": 0.1,
        "width": 1.0,
        "directions": (FREE, FREE, *(HELD,) * 4),
        "alternatives": (Alternative(np.eye(4), 0.1),) * 3,
        "status": "stalled",
    }
    verdict = judge(dataclasses.replace(GOOD, **changes))
    assert verdict.level == "suspect"
    assert len(verdict.reasons) == 7
    assert verdict.codes.count("unconstrained") == 2
    assert "3 other poses are equally likely" in verdict.reasons[5]


@pytest.mark.parametrize(
    ("status", "sentence", "code"),
    [
        ("no correspondences", "hardly any scan point comes within 20 of the target", "no_correspondences"),
        (
            "degenerate correspondences",
            "no pose: the correspondences lie on a line or at one point",
            "degenerate_correspondences",
        ),
    ],
)
def test_nothing_found_is_failed_whatever_else_is_known(status: str, sentence: str, code: str) -> None:
    for evidence in (GOOD, dataclasses.replace(GOOD, inliers=0.0, share_near=NAN, width=NAN, directions=())):
        verdict = judge(dataclasses.replace(evidence, found=False, status=status))
        assert verdict.level == "failed"
        assert verdict.codes == (code,)
        assert sentence in verdict.reasons[0]


@pytest.mark.parametrize(("changes", "words"), [
    ({"looking_away": 0.8}, "80 % of the scan's points near the target look the other way"),
    ({"viewpoint_behind": 0.3}, "30 % of the scan's own points stand behind others"),
])  # fmt: skip
def test_a_wrong_viewpoint_is_a_cause_of_doubts_and_none_itself(changes: dict[str, float], words: str) -> None:
    assert judge(dataclasses.replace(GOOD, **changes)).codes == ("accepted",)  # type: ignore[arg-type]
    found = judge(dataclasses.replace(GOOD, share_near=0.1, **changes))  # type: ignore[arg-type]
    assert found.codes == ("wrong_viewpoint", "low_inlier_fraction")
    assert words in found.reasons[0]


@pytest.mark.parametrize(("changes", "is_named"), [
    ({"has_border": True}, True),
    ({"has_border": False}, False),
    ({"has_border": True, "drift_along": (1.0, 0.0, 0.0)}, False),
])  # fmt: skip
def test_points_beside_an_open_target_may_be_of_a_face_that_it_lacks(changes: dict[str, Any], is_named: bool) -> None:
    found = judge(dataclasses.replace(GOOD, drift=1.0, **changes))
    assert found.codes == ("drift",)
    assert ("a face that the open target lacks" in found.reasons[0]) == is_named


@pytest.mark.parametrize(("inliers", "code"), [(2.0, "too_few_points"), (100.0, "no_pose")])
def test_a_loop_that_ended_with_nothing_is_failed(inliers: float, code: str) -> None:
    verdict = judge(dataclasses.replace(GOOD, found=False, inliers=inliers, status="stopped by observer"))
    assert (verdict.level, verdict.codes) == ("failed", (code,))


def test_a_frame_gets_no_advice_on_options_that_a_sequence_has_not() -> None:
    ended = dataclasses.replace(GOOD, status="iteration limit", near=INF)
    assert judge(ended).reasons == ("ICP did not converge: iteration limit",)
    assert judge(dataclasses.replace(GOOD, near=INF)).reasons == (
        "1000 inliers with residuals of 0.01 (one sigma), 95 % of the points; all degrees of freedom are constrained",
    )


def test_a_part_that_shrank_is_named_before_its_mirror_image() -> None:
    # At a wrong scale either image may fit better: 2 % too small gains 0.5 when mirrored, as a mirrored part does.
    found = judge(dataclasses.replace(GOOD, stretch=-0.02, mirror_gain=0.5))
    assert [reason.code for reason in found.reasons] == ["stretched", "mirrored"]


def test_whether_an_alternative_is_right_as_well_is_told_and_not_read_from_its_words() -> None:
    for words, is_symmetric in (("", True), ("the part looks nearly the same after a half-turn", False)):
        other = Alternative(np.eye(4), 0.1, words, _symmetric=is_symmetric)
        found = judge(dataclasses.replace(GOOD, alternatives=(other,)))
        assert ("alternative_poses" in found.codes) != is_symmetric
        rivals = next(check for check in found.checks if check.code == "alternative_poses")
        assert rivals.value == float(not is_symmetric)
        assert found._figures["rivals"] == float(not is_symmetric)
    # Of a file there are the words.
    assert Alternative(np.eye(4), 0.1, "the part looks the same")._is_symmetric
    assert not Alternative(np.eye(4), 0.1)._is_symmetric


def test_rays_that_agree_speak_for_a_pose_and_where_they_passed_through_much_they_do_not() -> None:
    alike = dataclasses.replace(GOOD, seen_alike=0.6, looked_through=0.0)
    assert judge(alike).confidence > judge(GOOD).confidence
    for other in ({"looked_through": 0.02}, {"seen_alike": 0.2}):
        assert judge(dataclasses.replace(alike, **other)).confidence == judge(GOOD).confidence
