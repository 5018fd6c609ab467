"""What follows from a fit is made once, and goes along where the pose alone decides it."""

from __future__ import annotations

from functools import partial
from itertools import count

from dqreg.registration.problem.derived_values import Derived, Key

COUNT: Key[int] = Key()
OF_POSE: Key[str] = Key(of_pose=True)


def test_a_value_is_made_once() -> None:
    derived, numbers = Derived(), count()
    assert [derived.once(COUNT, lambda: next(numbers)) for _ in range(2)] == [0, 0]
    assert next(numbers) == 1


def test_a_value_that_was_begun_is_waited_for() -> None:
    derived = Derived()
    for value in (7, 9):
        derived.begin(COUNT, partial(int, value))
        assert derived.once(COUNT, lambda: 8) == 7


def test_keys_of_one_type_are_not_the_same() -> None:
    derived, other = Derived(), Key[int]()
    derived.put(COUNT, 1)
    assert derived.once(other, lambda: 2) == 2
    assert derived.once(COUNT, lambda: 3) == 1


def test_what_the_pose_alone_decides_goes_along() -> None:
    derived, after = Derived(), Derived()
    derived.put(COUNT, 1)
    derived.put(OF_POSE, "before")
    derived.hand_on(after)
    assert after.once(OF_POSE, lambda: "after") == "before"
    assert after.once(COUNT, lambda: 2) == 2


def test_a_value_of_each_surface_is_its_own_and_what_is_not_there_is_not_known() -> None:
    derived, numbers = Derived(), count()
    assert derived.known(COUNT) is None
    assert [derived.once(COUNT, lambda: next(numbers), of=n) for n in (5, 7, 5)] == [0, 1, 0]
    assert derived.known(COUNT) is None
    derived.begin(COUNT, lambda: 9)
    assert derived.known(COUNT) == 9
