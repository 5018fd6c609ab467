"""Edges of the graph of scans: the registration of a pair, what it measures, and whether it is used."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by
from dqreg.trust.code_sets import DOUBTS_OF_RIGHT_POSE

# What an edge was used for, or why it was not.
EdgeCode = Literal[
    "used",
    "confirmed",
    "untried",
    "no_pose",
    "uncertain",
    "unconfirmed",
    "contradicts",
    "opposite_sides",
    "looked_through",
    "misfit",
    "ambiguous",
    "elsewhere",
]
TEXT_OF_CODE: dict[EdgeCode, str] = {
    "used": "used: its registration is accepted",
    "confirmed": "used: its registration is suspect, but loops through accepted edges close",
    "untried": "not tried",
    "no_pose": "not used: no pose was found",
    "uncertain": "not used: its pose is too uncertain to tell anything",
    "unconfirmed": "not used: its registration is suspect and no loop confirms it",
    "contradicts": "not used: it contradicts the other edges",
    "opposite_sides": "not used: it lays one side of a sheet on the other",
    "looked_through": "not used: it puts a scan where the scanner of another one looked through",
    "misfit": "not used: its scan does not fit all others together",
    "ambiguous": "not used: its scan fits all others together in several ways, or is held by too little",
    "elsewhere": "not used: it joins scans that are not placed",
}
# Node of a part in whose frame all scans are placed.
PART = -1


@dataclasses.dataclass(frozen=True, eq=False)
class Edge:
    """The registration of one scan to another.

    Attributes
    ----------
    target, source : int
        Numbers of the two scans; ``target`` is -1 for the part that `register_many` was given.
    registration : Registration
        ``registration.T_target_source`` maps the source's coordinates to the target's. Where its settings hold
        ``against``, numbers of scans, the source was registered to all of these together.
    used : bool
        Whether the poses rest on it.
    code : str
        Why: "used", "confirmed", "no_pose", "uncertain", "unconfirmed", "contradicts", "opposite_sides",
        "looked_through", "misfit", "ambiguous" or "elsewhere".
    chi2 : float
        Squared difference between this pose and the one of all scans together, in units of its covariance: about 6
        where the covariance tells all. NaN where one of the scans is not placed.
    overlap : float
        Fraction of the smaller scan that lies on the other where all scans are placed; NaN where one is not.
    """

    target: int
    source: int
    registration: Registration
    used: bool = False
    code: EdgeCode = "unconfirmed"
    chi2: float = np.nan
    overlap: float = np.nan

    @property
    def why(self) -> str:
        """The code in words."""
        return TEXT_OF_CODE[self.code]

    @property
    def level(self) -> str:
        """Level of the registration's verdict."""
        return self.registration.verdict.level

    @property
    def found(self) -> bool:
        """Whether it has a pose."""
        return bool(np.isfinite(self.registration.T_target_source).all())


def ended_in_error(edge: Edge) -> bool:
    """Whether its registration ended in an error, whose words are the reason of its verdict."""
    return edge.level == "failed" and "unreadable" in edge.registration.verdict.codes


def was_cut_off(edge: Edge) -> bool:
    """Whether the end of the run came before a pose was found: too little is known of its scans."""
    return not edge.found and (edge.code == "untried" or "search_time_limit" in edge.registration.verdict.codes)


def confidence_of_edge(edge: Edge) -> float:
    """Confidence of an edge; 0 where it is not known."""
    return float(np.nan_to_num(edge.registration.verdict.confidence))


def centre_of(result: Registration) -> FloatArray:
    """Point of the target frame about which the covariance of a result is."""
    return np.asarray(result.settings.get("centre", np.zeros(3)), dtype=np.float64)


def information_of_edge(result: Registration) -> FloatArray:
    """Inverse of a result's covariance, zero along free motions. Shapes: returns (6, 6)."""
    covariance = result.covariance
    if np.isfinite(covariance).all():
        # Scaled to ones on the diagonal: squares of radians and of millimetres lie far apart.
        scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(covariance / scale / scale[:, None])
        held = vectors / np.sqrt(np.maximum(values, 1e-12)) / scale[:, None]
        return np.asarray(held @ held.T)
    # Free motions have made NaN of their rows.
    if result.partial_information is not None:
        return result.partial_information
    return _by_motions(result)


def _by_motions(result: Registration) -> FloatArray:
    """What a file of old says motion by motion, each a displacement at half of the diagonal, of which none is free."""
    lever, centre = 0.5 * float(result.settings["diagonal"]), centre_of(result)
    information, scale = np.zeros((6, 6)), scaling_by(lever)
    free = [np.zeros(6)]
    for motion in result.observability:
        axis, point = np.array(motion.axis), np.array(motion.point)
        if motion.kind is None or not np.isfinite(axis).all():
            continue
        turn, shift = (axis, np.cross(axis, centre - point)) if motion.kind == "rotation" else (np.zeros(3), axis)
        along = scale * np.r_[turn, shift]
        along /= np.linalg.norm(along)
        if motion.is_free:
            free.append(along)
        else:
            information += np.outer(along, along) / max(motion.sigma, np.finfo(float).tiny) ** 2
    # A motion's shift along its own axis is not on file.
    held = np.eye(6) - np.linalg.pinv(np.array(free)) @ np.array(free)
    return np.asarray((held @ information @ held) * scale[:, None] * scale)


def is_weak(edge: Edge) -> bool:
    """Whether another start may find something better."""
    return edge.level != "accepted" and edge.code != "untried"


def better(old: Edge, new: Edge) -> Edge:
    """The new edge where it is accepted, or where the old one has no pose or alone is refused; else the old one."""
    if new.level == "accepted" and old.level != "accepted":
        return new
    if old.found and new.found and is_refused(old) and not is_refused(new):
        return new
    return old if old.found else new


def is_refused(edge: Edge) -> bool:
    """Whether the verdict holds something against the pose itself, and not only how well it is known."""
    return edge.level != "accepted" and not set(edge.registration.verdict.codes) <= DOUBTS_OF_RIGHT_POSE


def graph_of(edges: Sequence[Edge], count: int) -> PoseGraph:
    """The pose graph of edges that have a pose; the part is the node after the scans."""
    results = [edge.registration for edge in edges]
    return PoseGraph(
        count + 1,
        np.array([count if edge.target == PART else edge.target for edge in edges], dtype=np.int64),
        np.array([edge.source for edge in edges], dtype=np.int64),
        np.array([result.T_target_source for result in results]).reshape(-1, 4, 4),
        np.array([information_of_edge(result) for result in results]).reshape(-1, 6, 6),
        np.array([centre_of(result) for result in results]).reshape(-1, 3),
    )


def with_lower_targets(graph: PoseGraph) -> PoseGraph:
    """The same graph with the lower node of every edge as its target."""
    back = graph.targets > graph.sources
    low, high = np.minimum(graph.targets, graph.sources), np.maximum(graph.targets, graph.sources)
    inverse = pose.inverse(graph.measured)
    measured = np.where(back[:, None, None], inverse, graph.measured)
    # A left increment of a pose is one of its inverse, turned into the other frame and backwards.
    R = np.zeros((len(back), 6, 6))
    R[:, :3, :3] = R[:, 3:, 3:] = inverse[:, :3, :3]
    information = np.where(back[:, None, None], R @ graph.information @ R.transpose(0, 2, 1), graph.information)
    there = np.einsum("mij,mj->mi", inverse[:, :3, :3], graph.centres) + inverse[:, :3, 3]
    return PoseGraph(graph.count, low, high, measured, information, np.where(back[:, None], there, graph.centres))
