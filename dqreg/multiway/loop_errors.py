"""The errors of the loops of three, as a result tells them."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.selection.edge_selection import EdgeSelection


@dataclasses.dataclass(frozen=True)
class LoopError:
    """How well the poses of three pairs agree: the product round the loop should be the identity.

    Attributes
    ----------
    scans : tuple of int
        The three scans; -1 is the part.
    rotation_rad, translation : float
        Size of the product.
    chi2 : float
        Its square in units of its covariance; about 6 where the covariances tell all.
    used : bool
        Whether all three edges are used.
    sharp : bool
        Whether the covariances are narrow enough for the loop to tell anything.
    """

    scans: tuple[int, int, int]
    rotation_rad: float
    translation: float
    chi2: float
    used: bool
    sharp: bool


def loop_errors_of(selection: EdgeSelection, count: int) -> tuple[LoopError, ...]:
    """Of all loops of three edges, the worst of the used ones first."""
    loops = selection.loops
    used = np.array([selection.edges[row].used for row in selection.rows], dtype=bool)
    found = []
    for nodes, rows, twist, chi2, sharp in zip(
        loops.nodes.tolist(), loops.edges, loops.twists, loops.chi2, loops.sharp, strict=True
    ):
        a, b, c = (PART if node == count else int(node) for node in nodes)
        turn, shift = float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))
        found.append(LoopError((a, b, c), turn, shift, float(chi2), bool(used[rows].all()), bool(sharp)))
    return tuple(sorted(found, key=lambda loop: (not loop.used, not loop.sharp, -loop.chi2)))
