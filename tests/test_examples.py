from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.rigid import pose
from dqreg.synth import demo_case, load_case, worst_vertex_displacement
from dqreg.synth.parts import bracket

EXAMPLES = Path(__file__).parents[1] / "examples"


def main_of(name: str) -> Callable[..., Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]


@pytest.mark.parametrize("name", ["quick_start", "open3d_objects"])
def test_shipped_case_is_brought_home(name, capsys):
    # Truth: truth.json of the shipped case. 2e-5 of the part's diagonal is 3 um, six times the Cramer-Rao bound.
    case = load_case(demo_case())
    result = main_of(name)()
    error = worst_vertex_displacement(result.T_target_source, case.T_target_source, bracket()[0])
    assert error < 2e-5 * case.part_diagonal
    assert "accepted" in capsys.readouterr().out


def test_own_weight_counts_what_it_says(capsys):
    run = main_of("own_weight")()
    # The samples lie on the part itself, so the truth is the identity; the tolerance is that of the loop's stop.
    assert pose.angle_between(run.T_target_source, np.eye(4)) < 1e-6
    kept = run.weights > 0.0
    assert (run.pairs.closest.points[kept, 2] > 2.0).all()
    assert 0 < np.count_nonzero(kept) < len(kept)
    assert "converged" in capsys.readouterr().out


def test_race_ranks_exact_mesh_before_sampled_cad(capsys):
    # Known truth by construction of the virtual scans; both run on the same scan of about 20,000 points.
    errors = main_of("against_builtin_icp")([], pixels=150, seeds=1, samples=50_000)
    assert errors["dqreg"][0] < 5e-5
    assert errors["dqreg"][0] < errors["Open3D point-to-point"][0]
    assert "worst vertex" in capsys.readouterr().out
