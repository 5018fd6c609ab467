"""What the report asks of a registration: protocols, so that a result can hand itself to the report below it."""

from __future__ import annotations

from typing import Any, Protocol

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud, Surface
from dqreg.icp.history import Iteration
from dqreg.inspection import Deviations
from dqreg.trust.records import Alternative, Direction, Verdict


class RegisteredSource(Protocol):
    """The scan in target units, near the origin."""

    @property
    def cloud(self) -> PointCloud:
        """Points relative to ``origin``."""

    @property
    def origin(self) -> FloatArray:
        """What was subtracted from the scaled coordinates, (3,)."""

    @property
    def mesh(self) -> Mesh | None:
        """The mesh that the points were drawn from; None of a scan."""


class RegisteredTarget(Protocol):
    """The target near the origin."""

    @property
    def geometry(self) -> PointCloud | Mesh:
        """Geometry relative to ``origin``."""

    @property
    def origin(self) -> FloatArray:
        """What was subtracted from the coordinates, (3,)."""

    @property
    def surface(self) -> Surface:
        """What answers for the closest point."""


class RegisteredPair(Protocol):
    """Source and target of a registration."""

    @property
    def source(self) -> RegisteredSource:
        """The scan."""

    @property
    def target(self) -> RegisteredTarget:
        """The part or the other scan."""

    def placed(self, T_target_source: FloatArray) -> FloatArray:
        """Points of the scan under a pose, about the target's origin, (n, 3)."""


class RegistrationResult(Protocol):
    """A registration, see `dqreg.Registration`."""

    @property
    def T_target_source(self) -> FloatArray:
        """The pose, (4, 4); NaN where none was found."""

    @property
    def verdict(self) -> Verdict:
        """Level and reasons."""

    @property
    def status(self) -> str:
        """How the loop ended."""

    @property
    def covariance(self) -> FloatArray:
        """Of the pose, (6, 6)."""

    @property
    def observability(self) -> tuple[Direction, ...]:
        """Six motions, the weakest first."""

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """Other poses about equally likely."""

    @property
    def history(self) -> tuple[Iteration, ...]:
        """One record an iteration."""

    @property
    def rms(self) -> float:
        """Root mean square distance of the inliers."""

    @property
    def inlier_fraction(self) -> float:
        """Mean inlier probability."""

    @property
    def timings(self) -> dict[str, float]:
        """Seconds per stage."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings as resolved."""

    @property
    def inputs(self) -> RegisteredPair | None:
        """Both sides, where they are kept."""

    @property
    def scale(self) -> float:
        """What source lengths were multiplied with."""

    @property
    def scale_sigma(self) -> float:
        """Its standard deviation."""

    def _deviations(self, tolerance: float | None = None, *, reach: float | None = None) -> Deviations:
        """Signed distances of the scan from the target; where they have no sign, the record says so, no warning."""
