from __future__ import annotations

import importlib
import sys
from datetime import date
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from dqreg.compare import Protocol, compare, from_case, identity
from dqreg.compare.engines.registry import engine_specs
from dqreg.compare.store import Store
from dqreg.files import code_identity
from dqreg.synth import demo_case, load_case

ONCE = Protocol(settings=("manual",), repeats=1, isolate=False)


@pytest.fixture(scope="module")
def task():
    return from_case(load_case(demo_case()))


class Still:
    def __init__(self, T: np.ndarray) -> None:
        self.name, self.T = "still", T

    def register(self, task):
        return self.T


ENGINE = """
from helper import SHIFT, near
import numpy as np

class Mine:
    name = "mine"
    def register(self, task):
        return {body}

mine = Mine()
"""


def test_runs_of_an_edited_engine_file_are_made_anew_and_kept_ones_are_said(task, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    path, helper, out = tmp_path / "mine.py", tmp_path / "helper.py", tmp_path / "runs.jsonl"

    def found(body: str, shift: float) -> tuple[float, str]:
        helper.write_text(f"SHIFT = {shift}\ndef near(task):\n    return 0\n")
        path.write_text(ENGINE.format(body=body))
        sys.modules.pop("helper", None)
        importlib.invalidate_caches()
        made = compare(task, [path], protocol=ONCE, out=out)
        (one,) = made.runs
        return one.T_target_source[0][3], made.kept

    assert found("np.eye(4) + SHIFT", 0.0) == (0.0, "")
    taken, words = found("np.eye(4) + SHIFT", 0.0)
    assert taken == 0.0
    assert words == f"1 run taken from {out}, made on {date.today().isoformat()}."
    assert found("np.eye(4) + 2.0 + SHIFT", 0.0)[0] == 2.0
    # What it imports of one's own counts as well.
    taken, words = found("np.eye(4) + 2.0 + SHIFT", 10.25)
    assert taken == 12.25
    assert words == f"2 runs in {out} left out, made by other code or versions: mine."
    # The code as it was at first: its own run again.
    assert found("np.eye(4) + SHIFT", 0.0)[0] == 0.0
    assert len(Store(out).runs) == 3


def test_kept_runs_of_engines_depend_on_versions_and_on_parameters(task, tmp_path, monkeypatch):
    out = tmp_path / "runs.jsonl"
    compare(task, [Still(np.eye(4))], protocol=ONCE, out=out)
    assert compare(task, [Still(np.eye(4))], protocol=ONCE, out=out).kept
    assert compare(task, [Still(2.0 * np.eye(4))], protocol=ONCE, out=out).runs[0].kind == "not rigid"
    monkeypatch.setattr(code_identity, "installed_versions", lambda needs: dict.fromkeys(needs, "99"))
    assert "left out" in compare(task, [Still(np.eye(4))], protocol=ONCE, out=out).kept
    assert len(Store(out).runs) == 3


def test_what_peers_run_with_is_less_than_what_ours_do(monkeypatch):
    names = ["dqreg", "open3d point-to-plane"]
    before = [identity.identity(spec) for spec in engine_specs(names)]
    sources = code_identity._sources
    monkeypatch.setattr(code_identity, "_sources", lambda places: sources(places) + ("x" if places == ("",) else ""))
    after = [identity.identity(spec) for spec in engine_specs(names)]
    assert [one != other for one, other in zip(before, after, strict=True)] == [True, False]
    assert all((code_identity.PACKAGE / place).exists() for place in identity.OF_PEERS)


def test_a_method_that_stands_in_no_file_is_another_each_time(monkeypatch):
    made = type("Mine", (), {"name": "mine", "register": lambda self, task: np.eye(4), "__module__": "nowhere"})()
    assert len({identity.identity(spec) for spec in engine_specs([made]) for _ in range(2)}) == 2
    # One of a package that is installed stands in a file.
    monkeypatch.setattr(identity, "_is_own", lambda module: False)
    assert len({identity.identity(spec) for spec in engine_specs([Still(np.eye(4))]) for _ in range(2)}) == 1


def shifting(shift: float) -> SimpleNamespace:
    return SimpleNamespace(name="mine", register=lambda task: np.eye(4) + shift)


@pytest.mark.parametrize("make", [shifting, lambda shift: Holding(lambda: shift)])
def test_what_cannot_be_packed_is_never_taken_for_the_same(task, tmp_path, make):
    out = tmp_path / "runs.jsonl"
    assert compare(task, [make(0.0)], protocol=ONCE, out=out).runs[0].T_target_source[0][3] == 0.0
    again = compare(task, [make(2.0)], protocol=ONCE, out=out)
    assert again.runs[0].T_target_source[0][3] == 2.0
    assert "Never taken from a file: mine." in again.kept
    assert "left out" not in again.kept


class Holding:
    name, step = "mine", 0.0

    def __init__(self, shift) -> None:
        self.shift = shift

    def register(self, task):
        return np.eye(4) + self.shift() + self.step


def test_an_object_is_told_by_the_files_of_all_that_it_holds(task, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    out = tmp_path / "runs.jsonl"

    def found(shift: float) -> float:
        (tmp_path / "shifts.py").write_text(f"def shift(of=0.0):\n    return of + {shift}\n")
        sys.modules.pop("shifts", None)
        importlib.invalidate_caches()
        made = partial(importlib.import_module("shifts").shift, 0.0)
        return compare(task, [Holding(made)], protocol=ONCE, out=out).runs[0].T_target_source[0][3]

    assert [found(shift) for shift in (0.0, 0.0, 10.25)] == [0.0, 0.0, 10.25]
    assert len(Store(out).runs) == 2
    # A parameter of the class that was set while the program ran.
    monkeypatch.setattr(Holding, "step", 2.0)
    assert found(10.25) == 12.25


def test_a_function_that_stands_in_no_file_is_another_each_time(monkeypatch):
    def shift():
        return 0.0

    shift.__module__, shift.__qualname__ = "nowhere", "shift"
    monkeypatch.setitem(sys.modules, "nowhere", SimpleNamespace(shift=shift, __name__="nowhere"))
    assert len({identity.identity(spec) for spec in engine_specs([Holding(shift)]) for _ in range(2)}) == 2
