"""All stages put together into the result."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.loop_errors import loop_errors_of
from dqreg.multiway.pose_graph.edges import PART, Edge, graph_of
from dqreg.multiway.refinement.refine import Refined
from dqreg.multiway.result import Multiway
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.turntables.rotational_symmetry import UnobservableRotation
from dqreg.multiway.verdict import judge_scans
from dqreg.multiway.visibility.sides import Contradiction
from dqreg.trust.records import Reason


def assembled(
    views: tuple[View, ...],
    selection: EdgeSelection,
    joint: Refined,
    overlap: FloatArray,
    settings: dict[str, Any],
    seconds: dict[str, float],
    stopped: str,
    against: Sequence[Contradiction] = (),
    turns: Sequence[UnobservableRotation] = (),
    remarks: Sequence[Reason] = (),
    doubts: Sequence[Reason] = (),
) -> Multiway:
    """The result of all stages; copies of a scan get its pose, and remarks stand behind the verdict's reasons."""
    T, covariance = joint.T_world_scan.copy(), joint.covariance
    rows = np.array([k if view.copy_of is None else view.copy_of for k, view in enumerate(views)])
    T = T[rows]
    spread = (6 * rows[:, None] + np.arange(6)).ravel()
    covariance = covariance[np.ix_(spread, spread)]
    overlap = overlap[np.ix_(rows, rows)]
    graph = graph_of([selection.edges[row] for row in selection.rows], len(views))
    nodes = np.concatenate([T, np.eye(4)[None]])
    there = np.flatnonzero(
        np.isfinite(nodes[graph.targets]).all((1, 2)) & np.isfinite(nodes[graph.sources]).all((1, 2))
    )
    chi2 = np.full(len(selection.edges), np.nan)
    known = np.isfinite(nodes).all(axis=(1, 2), keepdims=True)
    chi2[selection.rows[there]] = graph.part(there).chi2(np.where(known, nodes, np.eye(4)))
    edges = tuple(
        dataclasses.replace(edge, chi2=float(chi2[k]), overlap=_overlap_of(overlap, edge))
        for k, edge in enumerate(selection.edges)
    )
    blocks = np.einsum("kikj->kij", covariance.reshape(len(views), 6, len(views), 6))
    size = float(settings["size"])
    ended = {"converged": joint.converged, "is_late": joint.is_late}
    verdict = judge_scans(
        views, selection, T, blocks, size, **ended, stopped=stopped, against=against, turns=turns, doubts=doubts
    )
    return Multiway(
        T_world_scan=T,
        verdict=dataclasses.replace(verdict, reasons=(*verdict.reasons, *remarks)),
        edges=edges,
        loop_errors=loop_errors_of(selection, len(views)),
        overlap=overlap,
        centre=joint.centre,
        joint=covariance,
        names=tuple(view.name for view in views),
        settings={**settings, "anchor": selection.anchor, "rounds": joint.rounds, "by_steps": joint.by_steps},
        timings={**seconds, "total": sum(seconds.values())},
        views=views,
    )


def _overlap_of(overlap: FloatArray, edge: Edge) -> float:
    return np.nan if edge.target == PART else float(overlap[edge.target, edge.source])
