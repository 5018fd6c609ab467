"""NumPy's numbers are taken where Python's are, True and text nowhere; each error names what was given."""

from typing import Any

import numpy as np
import pytest

from dqreg.compare.plan import Protocol
from dqreg.errors import InputError
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box


def test_numbers_of_numpy_are_numbers() -> None:
    assert Noise(range_sigma=np.float32(0.5)).range_sigma == 0.5
    assert Noise(range_sigma=np.int64(1)).range_sigma == 1
    assert Protocol(repeats=np.int64(3)).repeats == 3
    assert len(box((np.float32(3), 2, np.int64(1)))[0]) == len(box((3, 2, 1))[0])


@pytest.mark.parametrize("given", [True, "1", None, np.nan, -1.0])
def test_what_is_none_is_named(given: Any) -> None:
    with pytest.raises(InputError, match="range_sigma"):
        Noise(range_sigma=given)
    with pytest.raises(InputError, match="timeout"):
        Protocol(timeout=given)
    with pytest.raises(InputError, match="size"):
        box((given, 2, 1))
