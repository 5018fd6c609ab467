"""Where a scanner sits on the hand of a robot, with its uncertainty.

The robot looks at one part from eight stations. Each scan is registered to the part's CAD, which gives the part's pose
in the scanner's frame; the robot reports the pose of its hand. `robot_world_hand_eye` turns both into the scanner's
pose on the hand and the part's pose in the robot's base.

    python examples/hand_eye.py
"""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import dqreg
from dqreg.rigid import pose
from dqreg.solvers import robot_world_hand_eye
from dqreg.synth import Noise, Scanner, scan_mesh
from dqreg.synth.parts import bracket

STATIONS = 8


def station(rng: np.random.Generator) -> tuple[dqreg.PointCloud, np.ndarray]:
    """A scan in the scanner's frame, and T_part_eye, which nobody knows on a real robot."""
    view = np.append(rng.uniform(-1.0, 1.0, 2), 0.8)
    scan = scan_mesh(*bracket(), Scanner(views=(tuple(view),), pixels=80), Noise(range_sigma=0.03), rng=rng)
    T_part_eye = pose.exp(np.append(rng.uniform(-0.7, 0.7, 3), 400.0 * view))
    return dqreg.PointCloud(pose.apply(pose.inverse(T_part_eye), scan.points)), T_part_eye


def main(folder: str | Path | None = None):
    rng = np.random.default_rng(3)
    T_hand_eye, T_base_part = pose.exp([0.1, -0.2, 1.5, 20.0, 5.0, 80.0]), pose.exp([0.0, 0.0, 0.5, 700.0, 100.0, 0.0])
    part = dqreg.prepare_target(dqreg.Mesh(*bracket()))
    hands, measured = [], []
    for _ in range(STATIONS):
        scan, T_part_eye = station(rng)
        # Known from the mounting to 3 degrees and 5 mm, as an initial pose.
        start = pose.exp(np.append(rng.normal(0.0, 0.03, 3), rng.normal(0.0, 3.0, 3))) @ T_part_eye
        result = part.register(scan, start, effort="fast", keep_inputs=False)
        if result.verdict.level == "accepted":
            hands.append(T_base_part @ T_part_eye @ pose.inverse(T_hand_eye))
            measured.append(pose.inverse(result.T_target_source))
    fit = robot_world_hand_eye(pose.inverse(np.array(hands)), np.array(measured))
    error = fit.Y[:3, 3] - T_hand_eye[:3, 3]
    print(f"{len(hands)} of {STATIONS} stations; scanner on the hand (mm, 4x4):")
    print(fit.Y.round(4))
    print("standard deviations along x, y, z, mm:", np.sqrt(fit.covariance.diagonal()[9:]).round(4))
    print("true errors, mm:                      ", error.round(4))
    # The same stations for the command line: dqreg hand-eye stations.json
    file = Path(folder or mkdtemp(prefix="dqreg-")) / "stations.json"
    file.write_text(
        json.dumps({"hand": np.array(hands).tolist(), "eye": np.array(measured).tolist()}), encoding="utf-8"
    )
    print(f"wrote {file}")
    return fit, T_hand_eye


if __name__ == "__main__":
    main()
