"""Stacks of dual quaternions beside SciPy's RigidTransform: ``pytest tests/bench/test_rigid.py --benchmark-only``.

Both take turns in one run. The goal is a factor of two; SciPy keeps matrices, so "to matrix" costs it nothing. The
figures inform and never gate; what is asserted is that both say the same.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import transform

from dqreg.rigid import DualQuaternion, pose
from tests.bench.test_clouds import in_turns
from tests.bench.test_solve import report

ROUNDS = 5


@pytest.mark.parametrize("count", [1, 1000, 100_000])
def test_stacks_beside_scipy(benchmark, capsys, count):
    if not hasattr(transform, "RigidTransform"):
        pytest.skip("RigidTransform came with SciPy 1.16")
    rng = np.random.default_rng(0)
    A, B = pose.random(rng, reach=10.0, shape=(2, count))
    a, b = DualQuaternion.from_matrix(A), DualQuaternion.from_matrix(B)
    f, g = transform.RigidTransform.from_matrix(A), transform.RigidTransform.from_matrix(B)
    x, p, numbers = a.log(), rng.standard_normal((count, 3)), a.as_array()
    pairs = {
        "product": (lambda: a * b, lambda: f * g),
        "inverse": (a.inverse, f.inv),
        "log": (a.log, f.as_exp_coords),
        "exp": (lambda: DualQuaternion.exp(x), lambda: transform.RigidTransform.from_exp_coords(x)),
        "power": (lambda: a**0.3, lambda: f**0.3),
        "points": (lambda: a.apply(p), lambda: f.apply(p)),
        "from eight numbers": (
            lambda: DualQuaternion.from_array(numbers),
            lambda: transform.RigidTransform.from_dual_quat(numbers, scalar_first=True),
        ),
        "from matrix": (lambda: DualQuaternion.from_matrix(A), lambda: transform.RigidTransform.from_matrix(A)),
        "to matrix": (a.as_matrix, f.as_matrix),
    }
    runs = {
        f"{name} {who}": run for name, both in pairs.items() for who, run in zip(("ours", "SciPy"), both, strict=True)
    }
    best = {name: seconds.min(axis=0) for name, seconds in in_turns(runs, ROUNDS).items()}
    benchmark.pedantic(pairs["product"][0], rounds=1)
    ratios = {f"{name} ratio": best[f"{name} ours"][0] / best[f"{name} SciPy"][0] for name in pairs}
    report(benchmark, capsys, **ratios, **{f"{name} us": 1e6 * wall for name, (wall, _) in best.items()})
    np.testing.assert_allclose((a * b).as_matrix(), (f * g).as_matrix(), atol=1e-12)
