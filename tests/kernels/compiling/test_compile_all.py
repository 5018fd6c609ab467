from __future__ import annotations

import importlib
import pkgutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg import kernels
from dqreg.kernels import threads
from dqreg.kernels.compiling import cache, gc_pause, second_process
from dqreg.kernels.compiling import compile_all as compile_all_module
from dqreg.kernels.compiling.compile_all import compile_all
from dqreg.kernels.trees import closest_triangles
from tests.icp.scenes import bracket_mesh, bracket_points


def dispatchers() -> dict[str, Any]:
    names = [module.name for module in pkgutil.walk_packages(kernels.__path__, "dqreg.kernels.")]
    return {
        f"{name}.{key}": value
        for name in names
        for key, value in vars(importlib.import_module(name)).items()
        if hasattr(value, "nopython_signatures") and not isinstance(value, type) and value.__module__ == name
    }


def test_all_that_register_uses_is_compiled_beforehand_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "keep_beside_package", lambda: None)
    monkeypatch.setattr("dqreg.kernels.compiling.compile_all.keep_beside_package", lambda: None)
    compile_all()
    before = {name: len(found.nopython_signatures) for name, found in dispatchers().items()}
    assert before["dqreg.kernels.trees.closest_triangles.closest_places"] == 1
    points = bracket_points(30, seed=0)
    points.setflags(write=False)
    dqreg.register(points, bracket_mesh(), "identity")
    dqreg.register(np.asfortranarray(points), bracket_mesh(), "identity", effort="fast")
    after = {name: len(found.nopython_signatures) for name, found in dispatchers().items()}
    assert after == before
    # Each costs a second on its first use: one form of the arrays, and one of the plain numbers, is enough.
    assert not {name: dispatchers()[name].nopython_signatures for name, count in before.items() if count > 1}


def test_no_kernel_is_kept_in_two_forms_whatever_was_compiled_first() -> None:
    # A function inside kernels that two of them call with an int32 and an int64 has one form or both, by which of the
    # two is first: here every process that shares the folder, from either end, has left its own.
    compile_all()
    # A file may stand in the user's folder and beside the package.
    names = Counter(name.rpartition("-")[0] for name in {file.name for file in cache.kept()})
    assert len(names) > 100
    assert not [name for name, count in names.items() if count > 1]


def test_a_function_of_kernels_alone_refuses_to_be_called() -> None:
    # There is no code for it, and Numba would jump to where none is.
    with pytest.raises(TypeError, match="py_func"):
        closest_triangles.box_distance(np.zeros((1, 6)), 0, 0.0, 0.0, 1.0)
    assert closest_triangles.box_distance.py_func(np.zeros((1, 6)), 0, 0.0, 0.0, 2.0) == 4.0


def test_two_processes_share_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[list[str]] = []

    class Process:
        def __init__(self, words: list[str], **_: object) -> None:
            started.append(words)

        def terminate(self) -> None:
            started.append(["terminate"])

        def wait(self) -> None:
            started.append(["wait"])

    done: list[int] = []
    monkeypatch.setattr(compile_all_module, "keep_beside_package", lambda: None)
    monkeypatch.setattr(second_process.subprocess, "Popen", Process)
    monkeypatch.setattr(compile_all_module, "STEPS", (lambda: done.append(1), lambda: done.append(2)))
    for cores, expected in ((1, 0), (2, 3)):
        monkeypatch.setattr(threads, "thread_count", lambda cores=cores: cores)
        compile_all_module.compile_for_all_users()
        assert len(started) == expected
    assert done == [1, 2, 1, 2]
    # What the other process is told runs here, and goes the other way.
    exec(second_process.CODE)
    assert done[4:] == [2, 1]


def test_only_the_process_that_asked_starts_a_second_one_and_only_once(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []
    monkeypatch.setattr(second_process, "start", lambda: started.append(1))
    monkeypatch.setattr(gc_pause, "_freezes_survivors", False)
    monkeypatch.setattr(second_process, "_asking", None)
    monkeypatch.setattr(second_process, "_tells", None)
    second_process.start_if_allowed()
    assert not started
    second_process.allow()
    with monkeypatch.context() as fork:
        fork.setattr(second_process.os, "getpid", lambda: -1)
        second_process.start_if_allowed()
    assert not started
    second_process.allow()
    second_process.start_if_allowed()
    second_process.start_if_allowed()
    assert started == [1]


def test_a_command_starts_it_at_once_where_nothing_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    started: list[int] = []
    monkeypatch.setattr(second_process, "start", lambda: started.append(1))
    monkeypatch.setattr(gc_pause, "_freezes_survivors", False)
    monkeypatch.setattr(cache, "folders", lambda: ((tmp_path,), tmp_path))
    monkeypatch.setattr(second_process, "_asking", None)
    monkeypatch.setattr(second_process, "_tells", None)
    # A caller's process is not asked.
    second_process.start_where_nothing_is_kept()
    assert started == []
    (tmp_path / "kernel-1.code").touch()
    second_process.allow()
    second_process.start_where_nothing_is_kept()
    assert started == []
    (tmp_path / "kernel-1.code").unlink()
    second_process.start_where_nothing_is_kept()
    # The first kernel that has to be compiled starts no other.
    second_process.start_if_allowed()
    assert started == [1]
