"""Tasks from what users have: a case folder, or a scan and a target."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, as_pose
from dqreg.compare.challenge import Challenge, make_challenge
from dqreg.compare.poses import Truth, truth_of
from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.units import factor
from dqreg.given import read_any
from dqreg.source import MESH_SAMPLES, moved
from dqreg.synth import Case, load_case


def from_case(case: Case | str | os.PathLike[str], *, from_nothing: bool = False, **options: Any) -> Challenge:
    """Task of a case folder."""
    case = case if isinstance(case, Case) else load_case(case)
    source, target = read_any(case.scan, "scan"), read_any(case.part, "part")
    if not isinstance(source, PointCloud):
        raise InputError(f"{case.scan} holds a mesh; a case's scan is a cloud of points")
    truth = truth_of(case.truth, case.T_target_source, str(case.folder / "truth.json"))
    start = None if from_nothing else case.T_start
    name = case.folder.resolve().name
    return make_challenge(name, source, target, start, truth, noise=case.range_sigma, units=case.units, **options)


def from_pair(
    scan: Any,
    target: Any,
    start: FloatArray | str | None = "identity",
    truth: Truth | None = None,
    *,
    source_units: str | None = None,
    target_units: str | None = None,
    **options: Any,
) -> Challenge:
    """Task of a scan and a target."""
    source, goal = read_any(scan, "scan"), read_any(target, "target")
    if isinstance(source, Mesh):
        source = sample_mesh(source, MESH_SAMPLES, np.random.default_rng(0))
    scale = factor(source_units or source.units, target_units or goal.units)
    name = " on ".join(_name(value, word) for value, word in ((scan, "scan"), (target, "target")))
    T = np.eye(4) if isinstance(start, str) else start
    checked = None if T is None else as_pose(T, "start")
    units = target_units or goal.units or ""
    return make_challenge(name, moved(source, np.zeros(3), scale), goal, checked, truth, units=units, **options)


def _name(value: Any, word: str) -> str:
    return Path(value).name if isinstance(value, (str, os.PathLike)) else word
