"""Your own method against all others, on one judge; the class is all that it takes.

python examples/own_engine.py                                        # against dqreg, on the case that ships
dqreg compare --sweep quick --engine-file examples/own_engine.py     # against everyone
"""

from __future__ import annotations

import numpy as np
from rich.console import Console
from scipy.spatial import cKDTree

import dqreg
from dqreg.compare import Comparison, Protocol, compare
from dqreg.compare.tables import tables
from dqreg.report.table import print_tables
from dqreg.rigid import pose
from dqreg.synth import demo_case


class OwnEngine:  # noqa: D101
    name = "my trimmed ICP"

    def register(self, task):
        rng = np.random.default_rng(task.seed)
        source = rng.permutation(task.source.points)[:2_000]
        is_mesh = isinstance(task.target, dqreg.Mesh)
        target = dqreg.geometry.sample_mesh(task.target, 30_000, rng) if is_mesh else task.target
        tree, T = cKDTree(target.points), task.start
        for _ in range(100):
            distances, nearest = tree.query(pose.apply(T, source))
            kept = distances <= np.quantile(distances, 0.95)
            T = dqreg.solve(source[kept], target.points[nearest[kept]]).T_target_source
        return T


ENGINE = OwnEngine()


def main() -> Comparison:
    found = compare(demo_case(), ["dqreg", __file__], protocol=Protocol(settings=("manual",), repeats=1))
    print_tables(Console(), tables(found))
    return found


if __name__ == "__main__":
    main()
