"""Each row of the page "Coming from another package": both sides are evaluated and compared."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dqreg
from dqreg.rigid import DualQuaternion, pose, quaternion

PAGE = Path(__file__).parents[2] / "docs" / "coming_from.md"
ROW = re.compile(r"^\| `(.+)` \| `(.+)` \|$", re.M)
# Names that a row uses, and the module that must be there for it.
NEEDS = {
    "RigidTransform": "scipy.spatial.transform:RigidTransform",
    "Rotation": "scipy.spatial.transform:Rotation",
    "Slerp": "scipy.spatial.transform:Slerp",
    "pt": "pytransform3d.transformations",
    "pr": "pytransform3d.rotations",
    "ptr": "pytransform3d.trajectories",
    "pu": "pytransform3d.uncertainty",
    "gtsam": "gtsam",
    "pinocchio": "pinocchio",
}
# SciPy 1.17's power is right to 5e-8 only, while its own exponential of 0.3 times the logarithm, the next row, agrees
# with ours and with the matrix exponential to 1e-15.
# Fusion is an iteration there as here, and ends some digits earlier.
LOOSE = {"RigidTransform.from_matrix(T) ** 0.3": 1e-6, "pu.pose_fusion(Ts, Cs)[0]": 1e-9}


def rows() -> list[tuple[str, str, str]]:
    text = PAGE.read_text(encoding="utf-8")
    sections = [(part.splitlines()[0], part) for part in text.split("\n## ")[1:]]
    return [(name, there, here) for name, part in sections for there, here in ROW.findall(part)]


def numbers(value):
    """Array of whatever stands for a rotation, a pose or numbers."""
    return np.asarray(value.as_matrix() if hasattr(value, "as_matrix") else value, dtype=float)


@pytest.fixture(scope="module")
def given():
    rng = np.random.default_rng(8)
    T, T2 = pose.random(rng, reach=5.0, shape=(2,))
    # The second quaternion with the other sign, so that the shorter way is not the one as given.
    q = quaternion.normalize(rng.standard_normal(4))
    q2 = -quaternion.multiply(q, quaternion.exp([0, 0.4, -0.3, 0.5]))
    part = SimpleNamespace
    w, x, y, z = quaternion.from_matrix(T[:3, :3])
    msg = part(rotation=part(w=w, x=x, y=y, z=z), translation=part(**dict(zip("xyz", T[:3, 3], strict=True))))
    names = {"T": T, "T2": T2, "q": q, "q2": q2, "w": np.array([0.4, -0.7, 0.2]), "msg": msg}
    names |= {"x": np.array([0.4, -0.7, 0.2, 1.0, 2.0, -3.0]), "p": rng.standard_normal((6, 3))}
    names |= {"m": quaternion.rotate(q, np.eye(3)), "dq": DualQuaternion.from_matrix(T2).as_array()}
    roots = rng.standard_normal((5, 6, 6))
    names |= {"Ts": pose.exp(0.1 * rng.standard_normal((5, 6))) @ T, "Cs": roots @ np.swapaxes(roots, 1, 2) + np.eye(6)}
    return names | {"np": np, "pose": pose, "quaternion": quaternion, "DualQuaternion": DualQuaternion}


@pytest.mark.parametrize(("section", "there", "here"), rows())
def test_both_sides_of_a_row_agree(section, there, here, given):
    names = {**given, "solve": dqreg.solve}
    for name, place in NEEDS.items():
        if re.search(rf"\b{name}\b", there + here):
            module, _, attribute = place.partition(":")
            found = pytest.importorskip(module)
            names[name] = getattr(found, attribute, None) if attribute else found
            if names[name] is None:
                pytest.skip(f"{name} is not in this {module}")
    if "o3d" in there:
        from dqreg._open3d import load_open3d

        names["o3d"] = o3d = load_open3d()
        names["cloud"] = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(given["p"]))
    left, right = (numbers(eval(side, names)) for side in (there, here))
    if left.shape == (8,):
        left = left * np.sign(left[:4] @ right[:4])  # one motion, two signs
    np.testing.assert_allclose(left, right, rtol=0, atol=LOOSE.get(there, 1e-12))


def test_every_package_has_its_rows():
    counts = {name: sum(section == name for section, _, _ in rows()) for name, _, _ in rows()}
    least = {"SciPy": 20, "pytransform3d": 20, "gtsam": 10, "Pinocchio and Sophus": 6, "Open3D": 4, "ROS": 3}
    assert counts.keys() == least.keys()
    assert all(counts[name] >= number for name, number in least.items())


def test_poses_of_scipy_are_taken_wherever_a_pose_is():
    transform = importlib.import_module("scipy.spatial.transform")
    if not hasattr(transform, "RigidTransform"):
        pytest.skip("RigidTransform came with SciPy 1.16")
    from dqreg.registration.problem.problem import read_start
    from dqreg.solvers import Freedom, PoseCost

    T = pose.exp([0.4, -0.7, 0.2, 1.0, 2.0, -3.0])
    for given in (transform.RigidTransform.from_matrix(T), DualQuaternion.from_matrix(T)):
        np.testing.assert_allclose(read_start(given, None, None), T, atol=1e-15)
        np.testing.assert_allclose(pose.log(given), pose.log(T), atol=1e-14)
        np.testing.assert_allclose(pose.inverse(given), pose.inverse(T), atol=1e-14)
        np.testing.assert_allclose(pose.apply(given, [1, 2, 3]), pose.apply(T, [1, 2, 3]), atol=1e-14)
        cost = PoseCost.points(np.eye(3), 2 * np.eye(3))
        assert cost.value(given) == pytest.approx(cost.value(T))
        np.testing.assert_allclose(cost.gradient(T, frame=given), cost.gradient(T, frame=T), atol=1e-12)
        np.testing.assert_allclose(Freedom.only("rz", frame=given).frame, T, atol=1e-15)
    R = transform.Rotation.from_matrix(T[:3, :3])
    np.testing.assert_allclose(read_start(R, None, None), pose.from_parts(T[:3, :3], [0, 0, 0]), atol=1e-15)
    back = DualQuaternion.from_matrix(T).as_rigid_transform()
    np.testing.assert_allclose(back.as_matrix(), T, atol=1e-15)
    np.testing.assert_allclose(quaternion.from_matrix(R), quaternion.from_matrix(T[:3, :3]), atol=1e-15)


@pytest.mark.parametrize("package", ["gtsam", "open3d", "rows"])
def test_poses_of_others_are_taken_wherever_a_pose_is(package):
    from dqreg.registration.problem.problem import read_start

    T = pose.exp([0.4, -0.7, 0.2, 1.0, 2.0, -3.0])
    if package == "gtsam":
        given = pytest.importorskip("gtsam").Pose3(T)
    elif package == "open3d":
        from dqreg._open3d import load_open3d

        given = load_open3d().core.Tensor(T)
    else:
        given = T[:3]
    np.testing.assert_allclose(read_start(given, None, None), T, atol=1e-15)
    np.testing.assert_allclose(pose.log(given), pose.log(T), atol=1e-14)
    np.testing.assert_allclose(DualQuaternion.from_matrix(given).as_matrix(), T, atol=1e-15)
    np.testing.assert_allclose(dqreg.solvers.Freedom.only("rz", frame=given).frame, T, atol=1e-15)


def test_an_old_scipy_is_named(monkeypatch):
    import scipy.spatial.transform

    monkeypatch.delattr(scipy.spatial.transform, "RigidTransform", raising=False)
    with pytest.raises(dqreg.MissingDependencyError, match=r"scipy>=1\.16"):
        DualQuaternion.identity().as_rigid_transform()
