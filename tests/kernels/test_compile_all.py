from __future__ import annotations

import importlib
import pkgutil
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg import kernels
from dqreg.kernels import cache
from dqreg.kernels.compile_all import compile_all
from tests.icp.scenes import bracket_mesh, bracket_points


def dispatchers() -> dict[str, Any]:
    names = [module.name for module in pkgutil.iter_modules(kernels.__path__, "dqreg.kernels.")]
    return {
        f"{name}.{key}": value
        for name in names
        for key, value in vars(importlib.import_module(name)).items()
        if hasattr(value, "nopython_signatures") and value.__module__ == name
    }


def test_all_that_register_uses_is_compiled_beforehand_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "keep_beside_package", lambda: None)
    monkeypatch.setattr("dqreg.kernels.compile_all.keep_beside_package", lambda: None)
    compile_all()
    before = {name: len(found.nopython_signatures) for name, found in dispatchers().items()}
    assert before["dqreg.kernels.closest_places.closest_places"] == 1
    points = bracket_points(30, seed=0)
    points.setflags(write=False)
    dqreg.register(points, bracket_mesh(), "identity")
    dqreg.register(np.asfortranarray(points), bracket_mesh(), "identity", effort="fast")
    after = {name: len(found.nopython_signatures) for name, found in dispatchers().items()}
    assert after == before
    # Each costs a second on its first use: one form of the arrays, and one of the plain numbers, is enough.
    assert max(before.values()) == 1, before
