"""A weight of your own in the loop: count only the points of the scan that lie above a plane.

python examples/own_weight.py
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.geometry import Mesh, MeshSurface, prepare_scan, sample_mesh
from dqreg.icp import Correspondences, Icp, Run, WithinDistance
from dqreg.rigid import pose
from dqreg.synth.parts import bracket


@dataclasses.dataclass(frozen=True)
class Above:
    """Weight 1 for pairs whose place on the target is above the height, else 0."""

    height: float

    def __call__(self, pairs: Correspondences) -> np.ndarray:
        return np.where(pairs.closest.points[:, 2] > self.height, 1.0, 0.0)


def main() -> Run:
    part = Mesh(*bracket())
    scan = prepare_scan(sample_mesh(part, 20_000, np.random.default_rng(0)))
    start = pose.exp([0.02, -0.01, 0.03, 0.5, -0.5, 0.3])
    run = Icp(rejectors=(WithinDistance(10.0), Above(2.0))).run(scan, MeshSurface(part), start)
    print(run.status, f"{np.count_nonzero(run.weights)} of {len(scan)} points counted")
    print(run.T_target_source.round(9))
    return run


if __name__ == "__main__":
    main()
