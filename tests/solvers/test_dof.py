from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.solvers import Freedom
from dqreg.solvers.dof_words import WORDS
from tests.solvers.cost_cases import GROUPS, SUBSETS, frames, freedoms
from tests.solvers.problems import fast
from tests.strategies import floats, poses

SIX = st.lists(floats(-1.5, 1.5), min_size=6, max_size=6).map(np.array)


def allowed(words: tuple[str, ...], six: np.ndarray) -> np.ndarray:
    return np.where([word in words for word in WORDS], six, 0.0)


@fast
@given(freedoms(), SIX, poses(), poses())
def test_six_numbers_lead_to_a_pose_and_back(words, six, frame, reference) -> None:
    freedom, six = Freedom.only(*words, frame=frame), allowed(words, six)
    T = freedom.moved(reference, six)
    # Translations of up to a million round at 1e-10.
    reach = 1.0 + np.abs([frame[:3, 3], reference[:3, 3]]).max()
    np.testing.assert_allclose(freedom.coordinates(T, reference), six, atol=1e-14 * reach)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-14)


@fast
@given(SIX, st.integers(0, 100), st.integers(0, 100))
def test_the_numbers_are_a_turn_about_the_frames_origin_and_then_a_shift(six, frame, reference) -> None:
    F, T = frames(frame), frames(reference)
    turn, shift = pose.exp(np.r_[six[:3], 0, 0, 0]), pose.from_parts(np.eye(3), six[3:])
    expected = F @ shift @ turn @ pose.inverse(F) @ T
    np.testing.assert_allclose(Freedom.only("all", frame=F).moved(T, six), expected, atol=1e-13)


@fast
@given(freedoms(), poses(), poses(), poses())
def test_a_projection_is_allowed_and_stays_where_it_is(words, frame, T, reference) -> None:
    freedom = Freedom.only(*words, frame=frame)
    once = freedom.project(T, reference)
    reach = 1.0 + np.abs([frame[:3, 3], reference[:3, 3], T[:3, 3]]).max()
    six = freedom.coordinates(once, reference)
    np.testing.assert_allclose(six, allowed(words, six), atol=1e-14 * reach)
    np.testing.assert_allclose(freedom.project(once, reference), once, atol=1e-14 * reach)
    if not words:
        np.testing.assert_allclose(once, reference, atol=1e-15 * reach)


@pytest.mark.parametrize("words", SUBSETS, ids=" ".join)
def test_groups_are_those_whose_products_are_allowed(words: tuple[str, ...]) -> None:
    freedom = Freedom.only(*words, frame=frames(1))
    rng = np.random.default_rng(0)
    steps = [freedom.moved(np.eye(4), allowed(words, rng.uniform(-1, 1, 6))) for _ in range(2)]
    six = freedom.coordinates(steps[0] @ steps[1], np.eye(4))
    assert np.allclose(six, allowed(words, six), atol=1e-12) == freedom.is_group
    assert freedom.count == len(words)


def test_there_are_twenty_two_groups() -> None:
    # No turn: 8 choices of shifts. One axis: none, along, across or all shifts, thrice. All turns: none or all.
    assert len(GROUPS) == 8 + 3 * 4 + 2


@pytest.mark.parametrize("words", SUBSETS, ids=" ".join)
def test_twists_are_the_derivatives_of_allowed_motions(words: tuple[str, ...]) -> None:
    freedom, reference, centre = Freedom.only(*words, frame=frames(2)), frames(3), np.array([0.3, -1.0, 2.0])
    rng = np.random.default_rng(1)
    six, h = allowed(words, rng.uniform(-1, 1, 6)), 1e-6
    T = freedom.moved(reference, six)
    B = freedom.twists(T, reference, centre)
    assert B.shape == (6, len(words))
    for k in np.flatnonzero([word in words for word in WORDS]):
        d = h * np.eye(6)[k]
        change = freedom.moved(reference, six + d) @ pose.inverse(freedom.moved(reference, six - d))
        twist = pose.log(pose.about(change, -centre)) / (2 * h)
        # What is left outside the columns: truncation h^2 and rounding 1e-16 / h.
        outside = twist - B @ np.linalg.lstsq(B, twist, rcond=None)[0]
        assert np.abs(outside).max() < 1e-8


@fast
@given(freedoms(), SIX, poses(), st.integers(0, 100), st.tuples(*[floats(-5, 5)] * 3))
def test_another_origin_of_the_frame_allows_the_same(words, six, frame, reference, point) -> None:
    freedom, T = Freedom.only(*words, frame=frame), frames(reference)
    other = freedom.brought_to(np.array(point))
    moved = freedom.moved(T, allowed(words, six))
    reach = 1.0 + np.abs(frame[:3, 3]).max()
    back = other.coordinates(moved, T)
    np.testing.assert_allclose(back, allowed(words, back), atol=1e-14 * reach)
    # And it is no farther from the point.
    far = [np.linalg.norm(np.array(point) - f.frame[:3, 3]) for f in (freedom, other)]
    assert far[1] <= far[0] * (1 + 1e-12) + 1e-12
    if words in (("rz", "tx", "ty", "tz"), ("rx", "ry", "rz", "tx", "ty", "tz"), ("tx",), ()):
        np.testing.assert_allclose(other.frame[:3, 3], point, atol=1e-14 * reach)


@fast
@given(freedoms(), SIX, poses(), st.tuples(*[floats(-5, 5)] * 3))
def test_recentred_freedoms_count_from_other_points(words, six, frame, origin) -> None:
    freedom, step, T = Freedom.only(*words, frame=frame), pose.from_parts(np.eye(3), -np.array(origin)), frames(0)
    moved = freedom.moved(T, allowed(words, six))
    reach = 1.0 + np.abs(frame[:3, 3]).max()
    shifted = freedom.recentred(origin).moved(step @ T, allowed(words, six))
    np.testing.assert_allclose(shifted, step @ moved, atol=1e-14 * reach)


def test_words_in_all_their_forms() -> None:
    for given_words in (
        "rz tx ty",
        "ty,tx, RZ",
        ["rz", "tx ty"],
        ("rz", "tx", "ty"),
        "-rx -ry -tz",
        Freedom.only("rz", "tx", "ty"),
    ):
        assert str(Freedom.parse(given_words)) == "rz tx ty"
    assert str(Freedom.parse("none")) == "none"
    assert Freedom.parse("all").mask == (True,) * 6
    assert str(Freedom.parse("-t")) == str(Freedom.only("r")) == "rx ry rz"
    frame = frames(1)
    np.testing.assert_allclose(Freedom.parse("rz", frame).frame, frame, atol=1e-15)
    assert str(Freedom.parse(str(Freedom.only("rx", "tz")))) == "rx tz"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Freedom.parse("yaw"), "unknown motion 'yaw'; known are rx"),
        (lambda: Freedom.parse(""), "names no motion"),
        (lambda: Freedom.parse("rz -tx"), "with a minus each"),
        (lambda: Freedom.parse(3), "must be words"),
        (lambda: Freedom.parse([3]), "named by words"),
        (lambda: Freedom.parse(Freedom.only("rz"), frame=np.eye(4)), "frame of its own"),
        (lambda: Freedom.only("rz", frame=np.ones((4, 4))), "last row"),
        (lambda: Freedom.only("rz", frame=[1, 2]), "three numbers"),
        (lambda: Freedom.only("rz", frame=[1, 2, np.nan]), "NaN"),
        (lambda: Freedom.only("rz").moved(np.eye(4), [1, 0, 0, 0, 0, 0]), "zero where a motion is locked"),
        (lambda: Freedom.only("rz").moved(np.eye(4), [1, 0]), "six numbers"),
        (lambda: Freedom.only("rz").coordinates(np.zeros((4, 4)), np.eye(4)), "last row"),
    ],
)
def test_bad_input_is_named(call, words: str) -> None:
    with pytest.raises(InputError) as error:
        call()
    assert words in str(error.value)


@fast
@given(st.text(alphabet="rtxyz-, 1Ü", max_size=8))
def test_any_text_is_read_or_refused(text: str) -> None:
    # Nothing but the named error may come out, and what is read says the same again.
    with contextlib.suppress(InputError):
        freedom = Freedom.parse(text)
        assert Freedom.parse(str(freedom)).mask == freedom.mask
