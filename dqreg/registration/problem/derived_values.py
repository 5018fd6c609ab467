"""What follows from a fit, a problem or a target, made once and kept with it, by keys that know what they stand for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from dqreg.kernels.threads import Later

T = TypeVar("T")


class Key(Generic[T]):
    """Stands for one value of a type; the module that makes the value has the key as a constant."""

    def __init__(self, *, of_pose: bool = False) -> None:
        self.of_pose = of_pose  # Whether the pose alone decides it, however the loop ended


class Derived:
    """Values by their keys. Threads that ask at the same time may both make one: it is the same."""

    def __init__(self) -> None:
        self._values: dict[tuple[Key[Any], int], Any] = {}

    def once(self, key: Key[T], make: Callable[[], T], *, of: int = 0) -> T:
        """The value, made where it is not there yet, and waited for where it is being made.

        A target asks for one of each surface that stands for it, by the number of its points.
        """
        if (key, of) not in self._values:
            self._values[key, of] = make()
        found: T | Later[T] = self._values[key, of]
        return found.result() if isinstance(found, Later) else found

    def known(self, key: Key[T]) -> T | None:
        """The value if it is there, or being made; None where it is not."""
        found: T | Later[T] | None = self._values.get((key, 0))
        return found.result() if isinstance(found, Later) else found

    def begin(self, key: Key[T], make: Callable[[], T]) -> None:
        """Make a value beside the caller, who will ask for it."""
        if (key, 0) not in self._values:
            self._values[key, 0] = Later(make)

    def put(self, key: Key[T], value: T) -> None:
        """Take a value that was made elsewhere."""
        self._values[key, 0] = value

    def drop(self, key: Key[Any]) -> None:
        """Forget a value: whoever asks for it makes it anew."""
        self._values.pop((key, 0), None)

    def hand_on(self, other: Derived) -> None:
        """Give those that the pose alone decides to what is at the same pose."""
        other._values.update({key: value for key, value in self._values.items() if key[0].of_pose})
