"""How many threads a run may use, and what was in force."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any

from dqreg.open3d_gate import load_open3d


@contextlib.contextmanager
def limited(threads: int) -> Iterator[dict[str, Any]]:
    """Hold Open3D to a number of threads for the length of a block.

    OpenMP and BLAS read their environment when they are loaded, too late to change it here: what it says is recorded.
    Engines whose interface takes a number of threads pass it themselves.
    """
    utility = load_open3d().utility
    force = {"asked": threads, "open3d": None, "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS")}
    # Open3D before 0.20 has no such call; it listened to OMP_NUM_THREADS.
    if not hasattr(utility, "set_max_threads"):
        yield force
        return
    before = utility.get_max_threads()
    utility.set_max_threads(threads)
    try:
        yield {**force, "open3d": utility.get_max_threads()}
    finally:
        utility.set_max_threads(before)
