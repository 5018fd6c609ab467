from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from dqreg.kernels import cache
from tests.registration.batch.scenes import environment

# One small kernel, called; which folder took it, and whether it was found there.
CODE = """
import sys, warnings
from dqreg.kernels import cache
if "unwritable" in sys.argv:
    refused = sys.argv[sys.argv.index("unwritable") + 1:]
    writable = cache.is_writable
    cache.is_writable = lambda folder: not any(str(folder).startswith(r) for r in refused) and writable(folder)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from dqreg.kernels.compiled import compiled
    @compiled
    def doubled(x):
        return x + x
    @compiled
    def negative(x):
        return -x
    assert doubled(2.0) == 4.0 and negative(2.0) == -2.0
kept = sum(doubled.stats.cache_hits.values())
print(len(caught), kept, doubled._cache.cache_path, *[w.message for w in caught])
"""


def run(*words: str, **variables: str) -> list[str]:
    env = {k: v for k, v in environment().items() if k not in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "HOME")}
    done = subprocess.run(
        [sys.executable, "-c", CODE, *words], env={**env, **variables}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout.split(maxsplit=3)


def test_what_was_compiled_is_found_again_and_a_damaged_file_counts_as_absent(tmp_path: Path) -> None:
    first = run(XDG_CACHE_HOME=str(tmp_path))
    assert first[:3] == ["0", "0", str(tmp_path / "dqreg" / cache.beside_package().name)]
    (kept,) = Path(first[2]).glob("*doubled*")
    kept.write_bytes(kept.read_bytes()[:100])
    assert run(XDG_CACHE_HOME=str(tmp_path))[:2] == ["0", "0"]
    assert run(XDG_CACHE_HOME=str(tmp_path))[:2] == ["0", "1"]


def test_with_nothing_to_write_to_it_runs_and_says_so_once(tmp_path: Path) -> None:
    found = run("unwritable", "/", HOME=str(tmp_path), TMPDIR=str(tmp_path))
    assert found[:3] == ["1", "0", "None"]
    assert "in this process alone" in found[3]


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
    with pytest.warns(RuntimeWarning, match="set NUMBA_CACHE_DIR"):
        assert found_folder(monkeypatch, user, package) == temporary / f"dqreg-{os.getuid()}" / name
    with pytest.warns(RuntimeWarning, match="in this process alone"):
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
