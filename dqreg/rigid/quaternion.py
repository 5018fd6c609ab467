"""Quaternion functions on arrays (..., 4), scalar first (w, x, y, z); leading axes broadcast.

The index of Jia's notes in code: algebra (section 2), rotation (3), sequences (4), powers (appendix A),
derivatives and integration (B), interpolation (C), Jacobians (D). Public as ``dqreg.quaternion``.

All functions raise `InputError` where an array has the wrong last axes, a quaternion that must be of norm 1 is not, or
a quaternion or an axis that must have a direction is zero.
"""

from dqreg.rigid._algebra import (
    add,
    canonical,
    conjugate,
    cross_matrix,
    inverse,
    multiply,
    norm,
    normalize,
)
from dqreg.rigid._jacobians import (
    d_pq_d_p,
    d_pq_d_q,
    d_pqc_d_p,
    d_pqc_d_q,
    d_qv_d_q,
    d_qv_d_v,
    d_rotate_d_q,
    d_vq_d_q,
    d_vq_d_v,
)
from dqreg.rigid._kinematics import (
    angular_acceleration,
    angular_velocity,
    derivative,
    integrate,
    second_derivative,
)
from dqreg.rigid._matrices import (
    d_rotate_d_v,
    d_rotate_frame_d_v,
    from_matrix,
    left_matrix,
    right_matrix,
    to_matrix,
    to_rotation,
)
from dqreg.rigid._mean import mean
from dqreg.rigid._powers import exp, from_axis_angle, log, polar, power, to_axis_angle
from dqreg.rigid._rotation import (
    compose,
    compose_frames,
    interpolate_axis,
    interpolate_axis_angle,
    rotate,
    rotate_frame,
    slerp,
)

__all__ = [
    "add",
    "angular_acceleration",
    "angular_velocity",
    "canonical",
    "compose",
    "compose_frames",
    "conjugate",
    "cross_matrix",
    "d_pq_d_p",
    "d_pq_d_q",
    "d_pqc_d_p",
    "d_pqc_d_q",
    "d_qv_d_q",
    "d_qv_d_v",
    "d_rotate_d_q",
    "d_rotate_d_v",
    "d_rotate_frame_d_v",
    "d_vq_d_q",
    "d_vq_d_v",
    "derivative",
    "exp",
    "from_axis_angle",
    "from_matrix",
    "integrate",
    "interpolate_axis",
    "interpolate_axis_angle",
    "inverse",
    "left_matrix",
    "log",
    "mean",
    "multiply",
    "norm",
    "normalize",
    "polar",
    "power",
    "right_matrix",
    "rotate",
    "rotate_frame",
    "second_derivative",
    "slerp",
    "to_axis_angle",
    "to_matrix",
    "to_rotation",
]
