from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dqreg.kernels.compiling import cache, compiled
from tests.registration.batch.scenes import environment

CODE = """
from dqreg.kernels.compiling.compiled import compiled
@compiled
def doubled(x):
    return x + x
@compiled
def negative(x):
    return -x
assert doubled(2.0) == 4.0 and negative(2.0) == -2.0
"""


def doubled(x: float) -> float:
    return x + x


def was_kept() -> bool:
    """Call a function as a new process would: whether its code was found."""
    function: Any = compiled.compiled(doubled)
    assert function(2.0) == 4.0
    return sum(function.stats.cache_hits.values()) == 1


def test_what_was_compiled_is_found_again_and_a_damaged_file_counts_as_absent(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: ((tmp_path / "none", tmp_path), tmp_path))
    assert [was_kept(), was_kept()] == [False, True]
    (kept,) = tmp_path.glob("*.code")
    whole = kept.read_bytes()
    for damaged in (b"", whole[:100], b"junk" * 30):
        kept.write_bytes(damaged)
        assert [was_kept(), was_kept()] == [False, True]
    # One that is read only is read, and what cannot be written is no error.
    monkeypatch.setattr(compiled, "folders", lambda: ((tmp_path,), tmp_path / "gone"))
    assert was_kept()
    kept.unlink()
    assert not was_kept()
    assert list(tmp_path.glob("*.code")) == []


@pytest.mark.parametrize("version", ["0.60.0", "0.59.1"])
def test_code_is_kept_in_our_form_or_in_numbas_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, version: str
) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: ((tmp_path,), tmp_path))
    reduce, rebuild = compiled.keeping(version)
    assert (rebuild == compiled.CompileResult._rebuild) == (version == "0.59.1")
    monkeypatch.setattr(compiled, "REDUCE", reduce)
    monkeypatch.setattr(compiled, "REBUILD", rebuild)
    assert [was_kept(), was_kept()] == [False, True]


def test_folders_of_an_older_version_go_and_those_of_others_stay(tmp_path: Path) -> None:
    old, others, unmarked, busy, now = (
        tmp_path / f"kernels-{name}" for name in ("old", "others", "unmarked", "busy", "now")
    )
    for folder in (old, others, unmarked, busy, now):
        folder.mkdir()
        (folder / "kernel-1.code").write_bytes(b"code")
    cache.claim(old)
    cache.claim(busy)
    (others / cache.OWNER).write_text("/another/prefix\n/another/package\n", encoding="utf-8")
    # Whatever somebody else put there stays, and so does the folder.
    (busy / "notes.txt").write_text("mine", encoding="utf-8")
    (tmp_path / "kernels-link").symlink_to(others)
    cache.claim(now)
    left = {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*") if file.is_file()}
    assert left >= {"kernels-now/kernel-1.code", "kernels-others/kernel-1.code", "kernels-unmarked/kernel-1.code"}
    assert "kernels-busy/notes.txt" in left
    assert not old.exists()
    cache.claim(tmp_path / "kernels-gone")


def test_with_nothing_to_write_to_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: ((), None))
    assert not was_kept()


def found_folder(monkeypatch: pytest.MonkeyPatch, *refused: Path) -> Path | None:
    writable = cache.is_writable
    monkeypatch.setattr(cache, "is_writable", lambda f: not any(f.is_relative_to(r) for r in refused) and writable(f))
    try:
        read, written = cache.folders.__wrapped__()
    finally:
        monkeypatch.setattr(cache, "is_writable", writable)
    assert read[0] == cache.beside_package()
    assert written is None or read[-1] == written
    return written


@pytest.mark.skipif(sys.platform != "linux", reason="folders of Linux")
def test_the_order_of_the_folders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    named, user, package, temporary = (tmp_path / name for name in ("named", "user", "package", "temporary"))
    temporary.mkdir()
    name = cache.beside_package().name
    monkeypatch.setattr(cache, "beside_package", lambda: package / name)
    monkeypatch.setattr(cache.tempfile, "tempdir", str(temporary))
    monkeypatch.setenv("XDG_CACHE_HOME", str(user))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(named))
    assert found_folder(monkeypatch) == named / name
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert found_folder(monkeypatch) == user / "dqreg" / name
    assert found_folder(monkeypatch, user) == package / name
    with pytest.warns(UserWarning, match="set NUMBA_CACHE_DIR"):
        assert found_folder(monkeypatch, user, package) == temporary / f"dqreg-{os.getuid()}" / name
    with pytest.warns(UserWarning, match="in this process alone"):
        assert found_folder(monkeypatch, user, package, temporary) is None
    # Without a home there is no folder of the user.
    monkeypatch.setattr(cache.Path, "home", lambda: (_ for _ in ()).throw(RuntimeError))
    assert found_folder(monkeypatch) == package / name


@pytest.mark.skipif(os.name == "nt", reason="owners of POSIX")
def test_a_temporary_folder_that_others_may_write_to_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path))
    assert cache._temporary() is not None
    (tmp_path / f"dqreg-{os.getuid()}").chmod(0o777)
    assert cache._temporary() is None


def test_another_source_or_compiler_is_another_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    now = cache.digest()
    monkeypatch.setattr(cache.importlib.metadata, "version", lambda name: "0.0")
    cache.digest.cache_clear()
    other = cache.digest()
    monkeypatch.undo()
    (tmp_path / "kernel.py").write_text("", encoding="utf-8")
    monkeypatch.setattr(cache, "PACKAGE", tmp_path)
    cache.digest.cache_clear()
    third = cache.digest()
    monkeypatch.undo()
    cache.digest.cache_clear()
    assert len({now, other, third}) == 3
    assert cache.digest() == now


@pytest.mark.skipif(os.name == "nt", reason="terminals of POSIX")
def test_the_first_compilation_is_announced_in_one_line_on_a_terminal(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    env = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path)}
    said = []
    for _ in range(2):
        subprocess.run([sys.executable, "-c", CODE], env=env, stdout=subprocess.DEVNULL, stderr=theirs, check=True)
        os.write(theirs, b"end\n")
        text = ""
        while "end" not in text:
            text += os.read(ours, 4096).decode()
        said.append(text)
    assert said[0].count("compiling inner loops") == 1
    assert said[0].count("\n") == 2
    assert said[1] == "end\r\n"


def test_a_program_of_our_own_says_into_pipes_too_that_it_compiles_unless_it_is_quiet(tmp_path: Path) -> None:
    ours = """
from dqreg.cli.outputs import consoles
from dqreg.kernels.compiling import second_process
second_process.start = lambda: None
second_process.allow()
"""
    quiet = "consoles(quiet=True, as_json=False)\n"
    for number, (first, count) in enumerate([("", 0), (ours, 1), (ours + quiet, 0)]):
        env = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path / str(number))}
        done = subprocess.run([sys.executable, "-c", first + CODE], env=env, capture_output=True, text=True, check=True)
        assert done.stderr.count("compiling inner loops") == done.stderr.count("\n") == count


def test_code_that_is_kept_runs_without_what_types_are_inferred_with_and_what_few_ask_for() -> None:
    code = """
import sys
import numpy as np
import dqreg
box = np.array([[x, y, z] for x in range(3) for y in range(3) for z in range(3)], dtype=float)
dqreg.register(box, box, "identity", effort="fast", search="never")
print({"numba.np.linalg", "numba.np.arrayobj", "dqreg.inspection"} & set(sys.modules))
"""
    # Whatever has not been kept yet is compiled by the first process.
    told = [
        subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert told[1].stdout == "set()\n", told[1].stderr


def test_how_long_a_process_compiled_is_known_and_what_a_function_calls_is_not_counted_twice(tmp_path: Path) -> None:
    code = """
import json
from dqreg.icp.stopwatch import Stopwatch
from dqreg.kernels.compiling.compiled import compiled
@compiled
def inner(x):
    return x + x
@compiled
def outer(x):
    return inner(x) + inner(x + 1.0)
told = []
for _ in range(2):
    watch = Stopwatch()
    assert outer(1.0) == 6.0
    watch.end()
    told.append(watch.seconds)
print(json.dumps(told))
"""
    env = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path)}
    for is_kept in (False, True):
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
        first, second = json.loads(done.stdout)
        assert second.keys() == {"total"}
        assert ("compile" in first) != is_kept
        # Nothing else is done there.
        assert is_kept or 0.5 * first["total"] < first["compile"] <= first["total"]
