"""Parts that are nearly their own mirror image: whether a scan is of the part, or of its mirrored twin.

A left-hand part scanned for a right-hand one, or a sensor whose frame is left-handed, fits in all but a few features.
The misfit alone may be no more than clutter leaves; that it goes away in the mirror is no accident.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Scan, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.search.axes import proper_turns
from dqreg.search.flips import JUDGES, NARROW, REFINERS, STEPS, WIDE, maps_about_axes
from dqreg.search.refine import Sample, refine
from dqreg.search.scoring import weigh_up


def near_mirrors(mesh: Mesh, surface: Surface) -> FloatArray:
    """Improper turns about the principal axes that leave most of a part in place, but not all of it.

    Shapes: returns (k, 4, 4).
    """
    return maps_about_axes(mesh, surface, [-R for R in proper_turns()])


def gain_of_mirror(
    T_target_source: FloatArray, mirrors: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> float:
    """Mean log-likelihood that the scan gains when it is mirrored as well.

    Shapes: mirrors (k, 4, 4).
    """
    if not len(mirrors):
        return -np.inf
    some = scan.points[sample_rows(len(scan), REFINERS)]
    sample = Sample(some, np.zeros_like(some), some[:0], some[:0])
    turned = mirrors @ T_target_source
    widths = np.geomspace(WIDE, NARROW, STEPS) * surface.diagonal
    R, t = refine(turned[:, :3, :3], turned[:, :3, 3], sample, surface, None, widths, some[:0])
    R, t = np.concatenate([T_target_source[None, :3, :3], R]), np.concatenate([T_target_source[None, :3, 3], t])
    judges = scan.points[sample_rows(len(scan), JUDGES)]
    means = weigh_up(R, t, judges, surface, limit, floor).means
    return float(means[1:].max() - means[0])
