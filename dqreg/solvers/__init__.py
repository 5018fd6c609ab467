"""Closed-form solvers: from given matches of points and directions to the pose.

- `solve` (also ``dqreg.solve``): the closed form of 1991 with plain squared distances; `solve_many` does thousands
  of small problems in one call; `likelihood_weights` and `normal_variance` give weights of noise.
- `solve_rotation`: a rotation from directions alone, some of them exact; `cramer_rao`: the least covariance there is.
- `hand_eye`, `robot_world_hand_eye`: AX = XB and AX = YB, a sensor on a robot or beside it.
- `PoseCost`: the same cost for points, planes, lines, directions and priors together, additive over chunks, minimised
  by Newton's method; `Freedom` locks degrees of freedom in any frame.
- `walker1991`, `svd`, `horn`: the same pose by the papers' own letters, slow and literal, to measure others by.
- `moments_of`, `Moments`, `solve_moments`, `cost_of_pose`: the parts, for loops that have checked their arrays.
"""

from dqreg.solvers import jia, walker
from dqreg.solvers.batched_solver import Fits, solve_many
from dqreg.solvers.closed_form import solve_moments
from dqreg.solvers.cramer_rao import cramer_rao
from dqreg.solvers.dof import Freedom
from dqreg.solvers.exact_cost import cost_of_pose
from dqreg.solvers.fit import Fit, PoseFit
from dqreg.solvers.hand_eye import HandEyeFit, RobotWorldFit, hand_eye, robot_world_hand_eye
from dqreg.solvers.least_squares import solve
from dqreg.solvers.matches import LikelihoodWeights, Matches, likelihood_weights, normal_variance, read_matches
from dqreg.solvers.moments import Moments, moments_of
from dqreg.solvers.pose_cost import PoseCost
from dqreg.solvers.reference import horn, svd
from dqreg.solvers.rotation_only import RotationFit, solve_rotation
from dqreg.solvers.walker import WalkerFit, walker1991

__all__ = [
    "Fit",
    "Fits",
    "Freedom",
    "HandEyeFit",
    "LikelihoodWeights",
    "Matches",
    "Moments",
    "PoseCost",
    "PoseFit",
    "RobotWorldFit",
    "RotationFit",
    "WalkerFit",
    "cost_of_pose",
    "cramer_rao",
    "hand_eye",
    "horn",
    "jia",
    "likelihood_weights",
    "moments_of",
    "normal_variance",
    "read_matches",
    "robot_world_hand_eye",
    "solve",
    "solve_many",
    "solve_moments",
    "solve_rotation",
    "svd",
    "walker",
    "walker1991",
]
