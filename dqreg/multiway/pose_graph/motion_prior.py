"""What is known of the motions between scans before their pairs are believed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from dqreg._arrays import BoolArray
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.trust.records import Reason


class MotionPrior(Protocol):
    """Steps of a table, or starts."""

    @property
    def assumed(self) -> bool:
        """Whether it says more than pairs that are believed do."""

    def agree(self, graph: PoseGraph, edges: Sequence[Edge]) -> BoolArray:
        """Edges of a graph that come to it, and of which nothing else is doubted, (m,)."""

    def graph(self, count: int) -> PoseGraph:
        """It as edges of a graph of so many nodes."""

    def doubts(self) -> Iterator[Reason]:
        """What a verdict says of it."""
