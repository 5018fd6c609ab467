"""Hand-eye calibrations with known truth, and OpenCV's five methods on the same stations."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dqreg._arrays import FloatArray
from dqreg.rigid import pose
from tests.solvers.exact_oracle import random_rotation

METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
# A sensor that sees its target to a thousandth of a radian and half a millimetre, in metres.
SIGMAS = (1e-3, 5e-4)


def drawn_pose(rng: np.random.Generator, reach: float) -> FloatArray:
    return pose.from_parts(random_rotation(rng), rng.uniform(-reach, reach, 3))


def stations(rng: np.random.Generator, count: int) -> FloatArray:
    """Poses of a hand that looks at one place from within 40 degrees, in metres, (n, 4, 4)."""
    vectors = np.deg2rad(40.0) * rng.uniform(-1, 1, (count, 3))
    return pose.from_parts(Rotation.from_rotvec(vectors).as_matrix(), rng.uniform(-0.4, 0.4, (count, 3)))


def noisy(rng: np.random.Generator, T: FloatArray, sigmas: tuple[float, float]) -> FloatArray:
    """Poses with independent noise of rotation and translation, (..., 4, 4)."""
    turns = Rotation.from_rotvec(sigmas[0] * rng.normal(size=(len(T), 3))).as_matrix()
    return pose.from_parts(turns @ T[:, :3, :3], T[:, :3, 3] + sigmas[1] * rng.normal(size=(len(T), 3)))


def by_opencv(cv2, hands: FloatArray, targets: FloatArray, method: str) -> FloatArray:
    """T_hand_eye from T_base_hand and T_eye_target by one of OpenCV's methods, (4, 4)."""
    R, t = cv2.calibrateHandEye(
        list(hands[:, :3, :3]),
        list(hands[:, :3, 3]),
        list(targets[:, :3, :3]),
        list(targets[:, :3, 3]),
        method=getattr(cv2, f"CALIB_HAND_EYE_{method}"),
    )
    return pose.from_parts(R, t.ravel())


def increment(T_true: FloatArray, T: FloatArray) -> FloatArray:
    """Twist e of ``T_true = about(exp(e), T[:3, 3]) @ T``, (6,)."""
    turn = Rotation.from_matrix(T_true[:3, :3] @ T[:3, :3].T).as_rotvec()
    # Small enough that the left Jacobian is the identity to the size of e squared.
    return np.concatenate([turn, T_true[:3, 3] - T[:3, 3]])
