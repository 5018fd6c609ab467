"""Nearly symmetric parts: poses turned end for end that only a small feature tells apart, compared at the end.

A start that was given decides between them before any feature has its say; so the answer's own flips are tried, and
one that explains the scan as well, or better, is reported.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Scan, Surface, sample_mesh
from dqreg.geometry.normals import sample_rows
from dqreg.rigid import pose
from dqreg.search.axes import moments, principal_axes, proper_turns
from dqreg.search.refine import Sample, refine
from dqreg.search.rings import ring_steps
from dqreg.search.scoring import weigh_up

# A turn leaves most of the part in place where this share of its surface comes this close, in sizes; and all of it
# where that share does: then it is a symmetry, which no scan can decide.
MOST, NEARLY = 0.7, 5e-3
ALL, SAME = 0.998, 2e-3
CHECKED, SCREENED, SLACK = 2_000, 100, 0.2
# Points that say whether a flip is worth refining, how far off the part they say nothing more, in sizes, and what they
# may lack.
FEW, REACH, LACKS = 300, 0.02, 0.15
# Points that refine a flip and points that judge it; first and last width of the refinement, in sizes; steps.
REFINERS, JUDGES, WIDE, NARROW, STEPS = 1_000, 5_000, 6e-3, 1e-3, 6
# A flip is as good within so much mean log-likelihood: half of what the notch of a block costs that is 0.7 % of its
# surface. What only a smaller share of the points says is no decision.
AS_GOOD = 0.015


def near_flips(mesh: Mesh, surface: Surface) -> FloatArray:
    """Turns about the principal axes that leave most of a part in place, but not all of it; by a tooth, of a ring.

    Shapes: returns (k, 4, 4).
    """
    return maps_about_axes(mesh, surface, proper_turns() + ring_steps(mesh, surface))


def maps_about_axes(mesh: Mesh, surface: Surface, turns: list[FloatArray]) -> FloatArray:
    """Those of some orthogonal matrices that, about the principal axes, leave most of a part in place, but not all.

    Shapes: turns (3, 3), returns (k, 4, 4).
    """
    centre, axes = principal_axes(*moments(mesh))
    points = sample_mesh(mesh, CHECKED, np.random.default_rng(0)).points
    rotations = [axes @ turn @ axes.T for turn in turns]
    maps = [pose.from_parts(R, centre - R @ centre) for R in rotations]
    # Few points of all turns in one question; most turns move most of the part far away.
    few = np.concatenate([pose.apply(T, points[:: CHECKED // SCREENED]) for T in maps])
    shares = (surface.closest(few).distances <= NEARLY * surface.diagonal).reshape(len(maps), -1).mean(axis=1)
    found = []
    for T in (maps[k] for k in np.flatnonzero(shares >= MOST - SLACK)):
        distances = surface.closest(pose.apply(T, points)).distances / surface.diagonal
        if np.mean(distances <= NEARLY) >= MOST and np.mean(distances <= SAME) < ALL:
            found.append(T)
    return np.array(found).reshape(-1, 4, 4)


def flipped(
    T_target_source: FloatArray, flips: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> list[tuple[FloatArray, float]]:
    """Flips of a pose that explain the scan as well as it does, or better.

    Shapes: flips (k, 4, 4).
    """
    flips = _worth_refining(T_target_source, flips, scan, surface) if len(flips) else flips
    if not len(flips):
        return []
    some = scan.points[sample_rows(len(scan), REFINERS)]
    sample = Sample(some, np.zeros_like(some), some[:0], some[:0])
    turned = flips @ T_target_source
    widths = np.geomspace(WIDE, NARROW, STEPS) * surface.diagonal
    R, t = refine(turned[:, :3, :3], turned[:, :3, 3], sample, surface, None, widths, some[:0])
    R, t = np.concatenate([T_target_source[None, :3, :3], R]), np.concatenate([T_target_source[None, :3, 3], t])
    judges = scan.points[sample_rows(len(scan), JUDGES)]
    judgement = weigh_up(R, t, judges, surface, limit, floor)
    behind = judgement.means[0] - judgement.means
    rms = np.sqrt((judgement.distances**2).mean(axis=1))
    return [(pose.from_parts(R[k], t[k]), float(rms[k])) for k in range(1, len(R)) if behind[k] <= AS_GOOD]


def _worth_refining(T_target_source: FloatArray, flips: FloatArray, scan: Scan, surface: Surface) -> FloatArray:
    # A flip that leaves one point in six off the part is nowhere near as good, whatever its refinement mends.
    few = scan.points[sample_rows(len(scan), FEW)]
    places = np.concatenate([pose.apply(T, few) for T in (T_target_source, *(flips @ T_target_source))])
    apart = surface.closest(places).distances.reshape(-1, len(few)) / (REACH * surface.diagonal)
    gains = np.maximum(1.0 - apart**2, 0.0).mean(axis=1)
    return np.asarray(flips[gains[1:] >= gains[0] - LACKS])
