"""Open3D objects in, Open3D objects out: the same registration inside a program that already uses Open3D.

python examples/open3d_objects.py
"""

from __future__ import annotations

import numpy as np

import dqreg
from dqreg._open3d import load_open3d
from dqreg.synth import demo_case, load_case


def main() -> dqreg.Registration:
    open3d = load_open3d()  # or: import open3d, where its system libraries are installed
    case = load_case(demo_case())
    scan = open3d.io.read_point_cloud(str(case.scan))
    part = open3d.io.read_triangle_mesh(str(case.part))

    target = dqreg.prepare_target(part)  # once
    result = target.register(scan, start=case.T_start)  # for every scan
    aligned = scan.transform(result.T_target_source)

    print(result.verdict.level, f"{len(aligned.points)} points, middle now at {np.round(aligned.get_center(), 2)}")
    return result


if __name__ == "__main__":
    main()
