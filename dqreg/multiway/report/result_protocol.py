"""What reports and tables read of a multiway result: `Multiway` satisfies it."""

from __future__ import annotations

from typing import Any, Protocol

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans.scans import View
from dqreg.trust.records import Verdict


class Loop(Protocol):
    """Attributes of a `LoopError`."""

    @property
    def scans(self) -> tuple[int, int, int]:
        """The three scans."""

    @property
    def rotation_rad(self) -> float:
        """Rotation of the product round the loop."""

    @property
    def translation(self) -> float:
        """Its translation."""

    @property
    def chi2(self) -> float:
        """Its square in units of its covariance."""

    @property
    def used(self) -> bool:
        """Whether all its edges are used."""

    @property
    def sharp(self) -> bool:
        """Whether it tells anything."""


class ManyScans(Protocol):
    """Attributes of a `Multiway`."""

    @property
    def T_world_scan(self) -> FloatArray:
        """Poses, (n, 4, 4)."""

    @property
    def covariances(self) -> FloatArray:
        """Covariances, (n, 6, 6)."""

    @property
    def verdict(self) -> Verdict:
        """Level and reasons."""

    @property
    def edges(self) -> tuple[Edge, ...]:
        """All pairs."""

    @property
    def loop_errors(self) -> tuple[Loop, ...]:
        """All loops."""

    @property
    def overlap(self) -> FloatArray:
        """Overlaps, (n, n)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scans."""

    @property
    def settings(self) -> dict[str, Any]:
        """What was asked."""

    @property
    def timings(self) -> dict[str, float]:
        """Seconds per stage."""

    @property
    def views(self) -> tuple[View, ...] | None:
        """The scans."""

    @property
    def placed(self) -> tuple[int, ...]:
        """Numbers of the placed scans."""
