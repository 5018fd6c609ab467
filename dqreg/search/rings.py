"""Steps of a ring: turns by one tooth of a part whose teeth fit each other nearly, like a gear with one mark.

About an axis with equal moments across it the turns of the cube group say nothing: a ring of 24 teeth fits itself at
every 15 degrees.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Surface, sample_mesh
from dqreg.rigid.rotations import about_axis
from dqreg.search.axes import moments, principal_axes

# Smaller moment in the larger one of the two across the axis of a ring, at least.
EQUAL = 0.9
# Teeth that are tried, points that tell, and how far off the part they tell nothing more, in sizes.
TEETH, PLACES, NEARLY = range(5, 41), 500, 5e-3
# A step fits where so much of what half a step moves out of place comes back into it: else it is the whole of a disc
# that fits, at any angle, and the loop itself turns it.
COMES_BACK = 0.5
# Orders that are kept, the best ones.
KEPT = 4


def ring_steps(mesh: Mesh, surface: Surface) -> list[FloatArray]:
    """Turns by one step of a ring, either way, in the frame of the principal axes.

    Shapes: returns (3, 3).
    """
    mean, covariance = moments(mesh)
    values = np.linalg.eigvalsh(covariance)
    low, high = (bool(values[k] > EQUAL * values[k + 1]) for k in (0, 1))
    if low == high:
        return []
    axis = np.eye(3)[0 if high else 2]
    centre, axes = principal_axes(mean, covariance)
    arms = (sample_mesh(mesh, PLACES, np.random.default_rng(0)).points - centre) @ axes

    def in_place(angles: FloatArray) -> FloatArray:
        moved = np.concatenate([arms @ (axes @ about_axis(axis, angle)).T for angle in angles]) + centre
        apart = surface.closest(moved).distances / (NEARLY * surface.diagonal)
        return np.asarray(np.maximum(1.0 - apart**2, 0.0).reshape(len(angles), -1).mean(axis=1))

    steps = 2.0 * np.pi / np.array(TEETH)
    whole, half = in_place(steps), in_place(0.5 * steps)
    # An order beside the right one fits as well, a little worse.
    beside = np.maximum(np.r_[0.0, whole[:-1]], np.r_[whole[1:], 0.0])
    fits = np.flatnonzero((whole > beside) & (whole - half > COMES_BACK * (1.0 - half)))
    fits = fits[np.argsort(-whole[fits], kind="stable")][:KEPT]
    return [about_axis(axis, sign * steps[k]) for k in fits for sign in (1.0, -1.0)]
