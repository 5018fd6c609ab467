from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.synth import Case, demo_case, load_case


@pytest.fixture(autouse=True)
def _no_large_pictures(small_pictures: None) -> None:
    """What a report shows has its own tests: of many commands most of the time went into its pictures."""


@pytest.fixture(scope="package")
def case() -> Case:
    return load_case(demo_case())


@pytest.fixture
def start(tmp_path: Path, case: Case) -> Path:
    """Initial pose of the shipped case, as a file."""
    np.savetxt(tmp_path / "start.txt", case.T_start)
    return tmp_path / "start.txt"
