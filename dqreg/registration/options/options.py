"""Options of a registration, checked, and the settings of the loop that follow from them."""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Callable
from typing import Any, Literal, TypedDict, get_args

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import MAX_LENGTH
from dqreg._numbers import is_number
from dqreg.errors import InputError
from dqreg.files.length_names import OPTION_LENGTHS
from dqreg.icp import COARSE_POINTS, ESTIMATORS, Estimator, IcpSettings, Stopping
from dqreg.icp.estimators import cells_to_cells
from dqreg.icp.history import Iteration
from dqreg.icp.noise_by_face import (
    points_to_weighted_faces,
    points_to_weighted_planes,
    weights_by_face,
    weights_by_orientation,
)
from dqreg.registration.options.constraints import PoseConstraints
from dqreg.registration.options.option_checks import (
    as_float,
    read_time_limit,
    require_flag,
    require_observer,
    require_scale,
    require_seed,
    require_word,
)
from dqreg.search import Stage
from dqreg.solvers import Freedom
from dqreg.trust.evidence import Clutter

# What a type checker knows of the words that `dqreg.register` takes.
Effort = Literal["fast", "normal", "best"]
Method = Literal["auto", "dq", "dq-points", "svd", "plane", "generalised"]
Search = Literal["never", "doubt", "always"]
Units = Literal["check", "ignore"]


class RegisterOptions(TypedDict, total=False):
    """Options of `dqreg.register` for those who hand them on; ``time_limit`` is a name of its own there."""

    method: Method
    max_distance: float | None
    max_angle_deg: float
    source_units: str | None
    target_units: str | None
    effort: Effort
    seed: int
    accelerate: bool
    max_iterations: int
    convergence: float
    units: Units
    dof: str | Freedom | None
    prior: tuple[ArrayLike, ArrayLike] | None
    scale: float | Literal["solve"]
    viewpoint: ArrayLike | str | None
    search: Search
    clutter: Clutter
    expected_deviation: float | None
    observe: Callable[[Iteration], object] | None
    observe_search: Callable[[Stage], object] | None
    keep_inputs: bool
    verdict: bool
    tolerance: float | None


# Points of the last level.
EFFORTS: dict[Effort, int | None] = {"fast": 20_000, "normal": 60_000, "best": None}
# Fraction of the target's diagonal: a step that moves the points by less ends the last level.
CONVERGENCE = 1e-7
# Cells of a dense cloud: one point of each stands for its points.
CELLS: dict[Effort, int | None] = {"fast": 6_000, "normal": 10_000, "best": None}
# The same of clouds that a sensor saw from its stand, where all points say less: of 24 simulated streets under a LiDAR
# 15,000 cells left half the error of all points, in a twentieth of the time; 20,000 left more again.
CELLS_FROM_A_STAND = 15_000
# Options that take words, and which; of methods those that there are.
WORDS: dict[str, tuple[str, ...]] = {
    "effort": get_args(Effort),
    "search": get_args(Search),
    "units": get_args(Units),
    "clutter": get_args(Clutter),
}
# In place of a viewpoint: none is used, be there one in the file; or the origin of the scan's frame.
NO_VIEWPOINT, ORIGIN = "none", "origin"


# Options that a result repeats as they were given.
RECORDED = (
    "method",
    "max_distance",
    "max_angle_deg",
    "effort",
    "seed",
    "accelerate",
    "max_iterations",
    "convergence",
    "units",
    "time_limit",
    "scale",
    "search",
    "clutter",
    "expected_deviation",
    "verdict",
)


@dataclasses.dataclass(frozen=True, eq=False)
class Options:
    """Checked options of one registration, see `dqreg.register`."""

    method: Method
    max_distance: float | None
    max_angle_deg: float
    effort: Effort
    seed: int
    accelerate: bool
    max_iterations: int
    convergence: float
    units: Units = "check"
    time_limit: float | None = None
    scale: float | Literal["solve"] = 1.0
    search: Search = "doubt"
    source_units: str | None = None
    target_units: str | None = None
    dof: str | Freedom | None = None
    prior: Any = None
    viewpoint: Any = None
    observe: Callable[[Iteration], object] | None = None
    observe_search: Callable[[Stage], object] | None = None
    keep_inputs: bool = True
    clutter: Clutter = "allowed"
    expected_deviation: float | None = None
    verdict: bool = True

    def __post_init__(self) -> None:
        for name, words in {"method": ("auto", *ESTIMATORS), **WORDS}.items():
            require_word(name, getattr(self, name), words)
        if self.search == "always" and (self.dof is not None or self.prior is not None):
            raise InputError(
                'search="always" compares the pose with those of a global search, which know nothing of dof= and '
                "prior=: leave search out, or those"
            )
        for name in ("accelerate", "verdict", "keep_inputs"):
            require_flag(name, getattr(self, name))
        if not self.verdict and (self.search == "always" or self.solves_scale):
            given = 'search="always"' if self.search == "always" else 'scale="solve"'
            raise InputError(f"{given} compares poses by their verdicts: leave it out, or verdict=False")
        require_scale(self.scale)
        self._require_numbers()
        require_observer(self.observe, "observe")
        require_observer(self.observe_search, "observe_search")

    def _require_numbers(self) -> None:
        for name in (*OPTION_LENGTHS, "max_angle_deg", "max_iterations", "convergence"):
            value = getattr(self, name)
            if not is_number(value) and not (value is None and name in OPTION_LENGTHS):
                raise InputError(f"{name} must be a number; got {value!r}")
        count: object = self.max_iterations
        if not isinstance(count, numbers.Integral):
            raise InputError(f"max_iterations must be a whole number; got {count!r}")
        # A float32 would bring its short digits into all that is computed with it.
        for name in (*OPTION_LENGTHS, "max_angle_deg", "convergence"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else as_float(value))
        object.__setattr__(self, "time_limit", read_time_limit(self.time_limit))
        for name in OPTION_LENGTHS:
            if (value := getattr(self, name)) is not None and not 0.0 < value <= MAX_LENGTH:
                raise InputError(f"{name} must be a length above 0 in target units; got {value!r}")
        if not 0.0 < self.max_angle_deg <= 90.0:
            raise InputError(f"max_angle_deg must be above 0 and at most 90; got {self.max_angle_deg!r}")
        require_seed(self.seed)
        if self.max_iterations < 1:
            raise InputError(f"max_iterations must be at least 1; got {self.max_iterations!r}")
        if not 0.0 < self.convergence < 1.0:
            raise InputError(f"convergence is a share of the size, above 0 and below 1; got {self.convergence!r}")

    @property
    def recorded(self) -> dict[str, Any]:
        """What a result repeats of them."""
        return {name: getattr(self, name) for name in RECORDED}

    @property
    def freedom(self) -> Freedom | None:
        """Motions that are allowed; None allows all."""
        return None if self.dof is None else Freedom.parse(self.dof)

    @property
    def cells(self) -> int | None:
        """Cells to which dense clouds are thinned; None leaves them whole."""
        return CELLS[self.effort] if self.method in ("auto", "generalised") else None

    @property
    def cells_from_a_stand(self) -> int | None:
        """The same of those that were seen from one stand."""
        return CELLS_FROM_A_STAND if self.method == "auto" and self.effort == "best" else self.cells

    @property
    def without_viewpoint(self) -> bool:
        """Whether the place of a scanner that the source tells is not to be used."""
        return isinstance(self.viewpoint, str) and self.viewpoint == NO_VIEWPOINT

    @property
    def solves_scale(self) -> bool:
        """Whether the scale is asked for."""
        return self.scale == "solve"

    @property
    def fitted(self) -> int | None:
        """Points that need normals of their own: planes take the target's."""
        if self.method == "generalised":
            return None
        return COARSE_POINTS if self.method == "auto" else EFFORTS[self.effort]

    def icp_settings(
        self,
        max_distance: float,
        constraints: PoseConstraints,
        kernel_scale: float | None = None,
        *,
        even: bool = False,
    ) -> IcpSettings:
        """Parts of the loop; between clouds that are downsampled evenly, planes are fitted at every point."""
        auto = self.method == "auto"
        coarse: Estimator = ESTIMATORS["dq" if auto else self.method]
        fine: Estimator | None = points_to_weighted_planes if auto else None
        last: Estimator | None = points_to_weighted_faces if auto else None
        cells: Estimator | None = None
        if auto and even:
            fine, cells = ESTIMATORS["generalised"], cells_to_cells
        if constraints.any:
            cells = None
            coarse = constraints.estimator(planes=self.method == "plane")
            fine, last = (
                constraints.estimator(planes=True, weighed_by=weigh) if auto else None
                for weigh in (weights_by_orientation, weights_by_face)
            )
        return IcpSettings(
            estimator=coarse,
            fine=fine,
            last=last,
            cells=cells,
            max_distance=max_distance,
            finest=EFFORTS[self.effort],
            first_kernel_scale=kernel_scale,
            max_angle_rad=float(np.deg2rad(self.max_angle_deg)),
            accelerate=self.accelerate,
            stopping=Stopping(convergence=self.convergence, iterations=self.max_iterations),
        )
