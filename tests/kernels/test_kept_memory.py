from __future__ import annotations

import os
import platform
import subprocess
import sys

import pytest

ROUNDS, PAGES_OF_AN_ARRAY = 20, 390
PROGRAM = f"""
import resource

import numpy as np

import dqreg.kernels.threads


def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def used_and_given_back():
    one, other = np.ones(200_000), np.ones(200_000)


used_and_given_back()
before = faults()
for _ in range({ROUNDS}):
    used_and_given_back()
print(faults() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the rule is glibc's")
def test_memory_that_was_given_back_is_not_mapped_anew() -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, env=environment)
    assert int(done.stdout) < ROUNDS * PAGES_OF_AN_ARRAY / 10
