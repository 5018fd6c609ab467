from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dqreg.kernels.compiling import compiled, file_locks
from dqreg.kernels.compiling.file_locks import FileLocks
from tests.kernels.compiling.test_cache import doubled
from tests.registration.batch.scenes import environment

NAME = Path("kernel.code")
# Each process says whether it had to compile; both begin at the same sign.
RACE = """
import sys
from dqreg.kernels.compiling.compiled import compiled
from tests.kernels.compiling.test_cache import doubled
function = compiled(doubled)
print("ready", flush=True)
sys.stdin.readline()
assert function(2.0) == 4.0
print(sum(function.stats.cache_misses.values()))
"""

pytestmark = pytest.mark.skipif(os.name == "nt", reason="locks of POSIX")


def test_of_two_processes_one_compiles(tmp_path: Path) -> None:
    env = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path)}
    both = [
        subprocess.Popen(
            [sys.executable, "-c", RACE], env=env, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        for _ in range(2)
    ]
    for each in both:
        assert each.stdout is not None
        assert each.stdout.readline() == "ready\n"
    for each in both:
        assert each.stdin is not None
        each.stdin.write("\n")
        each.stdin.flush()
    assert sorted(each.communicate(timeout=120)[0].strip() for each in both) == ["0", "1"]
    assert list(tmp_path.rglob("*.lock")) == []


def test_a_lock_is_waited_for_no_longer_than_patience(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(file_locks, "PATIENCE", 0.05)
    first, second = FileLocks(), FileLocks()
    assert first.acquire(tmp_path, NAME)
    assert not second.acquire(tmp_path, NAME)
    # The holder itself never waits: after an interrupted compilation it compiles again.
    assert not first.acquire(tmp_path, NAME)
    first.release(NAME)
    assert second.acquire(tmp_path, NAME)
    second.release(NAME)
    assert not first.acquire(None, NAME)
    assert not first.acquire(tmp_path / "absent", NAME)


def test_a_compilation_that_fails_does_not_stop_the_next(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: ((tmp_path,), tmp_path))
    function = compiled.compiled(doubled)
    for _ in range(2):
        with pytest.raises(Exception, match=r"(?i)typing|undeclared|invalid use"):
            function({1: 2})  # type: ignore[arg-type]
    assert function(2.0) == 4.0
