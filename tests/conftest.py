from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real scans; the test is skipped where they are not."""
    beside = Path(__file__).parents[1].parent / "shared" / "data"
    folder = Path(os.environ.get("DQREG_DATA") or beside)
    if not folder.is_dir():
        pytest.skip("real scans are not here: set DQREG_DATA")
    return folder
