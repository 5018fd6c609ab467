"""Rigid motions: quaternions, dual quaternions, twists and 4x4 poses, all by one set of conventions.

- Rotations are active (they move points, the frame stands) and right-handed.
- Quaternions are Hamilton's, scalar first: w, x, y, z. q rotates a vector v to q v q*, and p q rotates by q
  first. q and -q are the same rotation; the canonical one has a positive first non-zero component.
- ``T_target_source`` maps source coordinates to target coordinates, p_target = R p_source + t. Products read
  from right to left and equal neighbours cancel: ``T_a_c = T_a_b @ T_b_c``.
- A twist is six numbers, the rotation vector first, then the translation part, and acts as a left increment:
  ``T = exp(twist) @ T0``.
- A dual quaternion is (real, dual): ``real`` the rotation, ``dual`` half the translation times ``real``,
  written as quaternions. It is the exponential of half its twist.
- Angles are radians. Lengths are in the caller's unit.
"""

from dqreg.rigid import lines, pose, quaternion
from dqreg.rigid.blending import blend
from dqreg.rigid.dual_quaternion import DualQuaternion
from dqreg.rigid.screw import DualNumber, Screw
from dqreg.rigid.trajectory import Trajectory

__all__ = ["DualNumber", "DualQuaternion", "Screw", "Trajectory", "blend", "lines", "pose", "quaternion"]
