from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dqreg.files.natural_order import is_shell_order, natural_order

NAMES = st.text(st.sampled_from("0129_. ab²³٣½\u0967é"), min_size=1, max_size=8)


@given(st.lists(st.integers(0, 10**6), min_size=2, unique=True), NAMES)
def test_files_are_ordered_as_they_are_numbered(numbers: list[int], stem: str) -> None:
    names = [Path(f"{stem}_{number}.ply") for number in numbers]
    assert sorted(names, key=natural_order) == [Path(f"{stem}_{number}.ply") for number in sorted(numbers)]


@given(st.lists(NAMES, unique=True, max_size=4))
def test_any_names_have_one_order(names: list[str]) -> None:
    # Whatever order a folder lists them in: 01 and 1 are one number.
    orders = {tuple(sorted(some, key=natural_order)) for some in itertools.permutations(names)}
    assert len(orders) == 1


def test_a_digit_that_counts_nothing_is_text() -> None:
    assert sorted(["²1.pcd", "²10.pcd", "²2.pcd"], key=natural_order) == ["²1.pcd", "²2.pcd", "²10.pcd"]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["s1.ply", "s10.ply", "s2.ply"], True),
        # Shells of most languages leave the point out.
        (["s10.ply", "s1.ply", "s2.ply"], True),
        (["s1.ply", "s2.ply", "s10.ply"], False),
        (["s2.ply", "s10.ply", "s1.ply"], False),
        (["s01.ply", "s02.ply", "s10.ply"], False),
        # Numbers of what is no row, and decimals.
        (["a10.ply", "b2.ply", "b3.ply"], False),
        (["t0.25.ply", "t0.5.ply"], False),
    ],
)
def test_the_order_of_a_shell_is_told_from_a_choice(names: list[str], expected: bool) -> None:
    assert is_shell_order([Path("scans", name) for name in names]) == expected
