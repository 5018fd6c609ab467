"""NumPy's numbers are taken where Python's are, True and text nowhere; each error names what was given."""

from typing import Any

import numpy as np
import pytest

from dqreg.compare.plan import Protocol
from dqreg.errors import InputError
from dqreg.inspection.tolerances import require_share
from dqreg.registration.batch import Workers
from dqreg.report.report_data import checked_tolerance
from dqreg.synth import Motion
from dqreg.synth.cameras import require_rays
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box
from dqreg.synth.tactile import TactileProbe


def test_numbers_of_numpy_are_numbers() -> None:
    assert Noise(range_sigma=np.float32(0.5)).range_sigma == 0.5
    assert Noise(range_sigma=np.int64(1)).range_sigma == 1
    assert Protocol(repeats=np.int64(3)).repeats == 3
    assert Workers(workers=np.int64(2), timeout=np.float32(9)).workers == 2
    assert TactileProbe(points=np.int64(30)).points == 30
    assert Motion(reference=np.float32(0.5)).reference == 0.5
    assert checked_tolerance(np.float32(0.5)) == 0.5
    require_share(np.float32(0.5))
    require_rays(1, pixels=np.int16(30_000), rings=np.int16(3))
    assert len(box((np.float32(3), 2, np.int64(1)))[0]) == len(box((3, 2, 1))[0])


@pytest.mark.parametrize("given", [True, "1", None, np.nan, -1.0])
def test_what_is_none_is_named(given: Any) -> None:
    with pytest.raises(InputError, match="range_sigma"):
        Noise(range_sigma=given)
    with pytest.raises(InputError, match="timeout"):
        Protocol(timeout=given)
    with pytest.raises(InputError, match="workers"):
        Workers(workers=given if given is not None else "all")
    with pytest.raises(InputError, match="size"):
        box((given, 2, 1))
