from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys

import pytest

# One registration in a process of its own: the digest of all that result.json holds but the clock.
PROGRAM = """
import hashlib, json, sys
from dqreg.registration.register import register
from dqreg.geometry import Mesh
from tests.hostile.scenes import PART, SCAN, START
start = None if sys.argv[1] == "search" else START
source = Mesh(PART.vertices + 1.0, PART.faces) if sys.argv[1] == "mesh" else SCAN
for _ in range(int(sys.argv[2])):
    plain = register(source, PART, start, effort="fast", seed=3).to_dict()
    del plain["timings"]
    for record in plain["history"]:
        del record["seconds"]
    print(hashlib.sha256(json.dumps(plain, allow_nan=False).encode()).hexdigest())
"""


def digests(task: str, threads: int, repeats: int) -> list[str]:
    """Digests of repeats in one fresh process with so many threads."""
    count = {name: str(threads) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
                                             "TBB_NUM_THREADS")}  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, task, str(repeats)],
        env={**os.environ, **count, "PYTHONHASHSEED": str(threads), "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.parametrize("task", [pytest.param("start", marks=pytest.mark.soak), "search"])
def test_fresh_processes_with_one_and_two_threads_give_the_same_bytes(task: str) -> None:
    repeats = 2 if task == "start" else 1
    found = digests(task, 1, repeats) + digests(task, 2, repeats)
    assert len(found) == 2 * repeats
    assert len(set(found)) == 1


@pytest.mark.soak
@pytest.mark.parametrize("task", ["start", "mesh", "search"])
def test_twenty_fresh_processes_give_the_same_bytes(task: str) -> None:
    found = [digest for k in range(20) for digest in digests(task, 1 + k % 2, 2)]
    assert len(found) == 40
    assert len(set(found)) == 1
    assert len(hashlib.sha256(json.dumps(found).encode()).hexdigest()) == 64
