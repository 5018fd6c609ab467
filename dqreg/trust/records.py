"""Records that a registration is made of: verdict and reasons, directions, alternatives. Values only."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from dqreg._arrays import FloatArray
from dqreg._records import lock, made_once, remember, remembered
from dqreg.solvers.motion_words import UNKNOWN, Kind, Vector

Level = Literal["accepted", "suspect", "failed"]
# What a reason of a verdict is about; docs/failures.md has the same list with what to do. Never renamed: files hold it.
Code = Literal[
    # accepted
    "accepted",
    "first_frame",
    # failed
    "no_correspondences",
    "degenerate_correspondences",
    "too_few_points",
    "no_pose",
    "lost",
    "unreadable",
    "internal_error",
    # suspect
    "few_inliers",
    "low_inlier_fraction",
    "falling_inlier_fraction",
    "forbidden_motion",
    "stretched",
    "mirrored",
    "deviating_patches",
    "contradicting_surface",
    "clutter",
    "looked_through",
    "faces_apart",
    "ends_apart",
    "rims_apart",
    "rims_elsewhere",
    "opposed_edges",
    "closed_hole",
    "one_plane",
    "disagreeing_normals",
    "outliers",
    "large_residuals",
    "wavy",
    "bent",
    "deformed",
    "drift",
    "random_fit",
    "unconstrained",
    "large_uncertainty",
    "weakly_constrained",
    "alternative_poses",
    "search_time_limit",
    "not_converged",
    "low_confidence",
    "not_judged",
    "scale_unobservable",
    "scale_misfit",
    "scale_ambiguous",
    "scale_uncertain",
    "time_stamp",
    "untrusted_map",
    "contradicting_prediction",
    # many scans
    "scan_left_out",
    "unmoved_scans",
    "other_frame",
    "deformed_scan",
    "islands",
    "unconfirmed_scan",
    "unconfirmed_edge",
    "duplicate_scan",
    "contradicting_edge",
    "wrong_viewpoint",
    "opposite_sides",
    "contradicted_start",
    "contradicted_prior",
    # notes
    "local_difference",
    "dropped_points",
    "stray_points",
    "repeated_faces",
    "not_deskewed",
    "held_by_prediction",
    "new_clock",
    "sought_in_map",
]


class Reason(str):
    """A sentence of a verdict, with a stable code beside it; "" where a file of old gives none."""

    code: Code | Literal[""]

    def __new__(cls, sentence: str, code: Code | Literal[""] = "") -> Reason:
        """The sentence with its code."""
        reason = super().__new__(cls, sentence)
        reason.code = code
        return reason

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        """What a copy is made of."""
        return str(self), self.code


Relation = Literal["at least", "at most"]
# Shares have the unit "1"; "%" in a file of old, where they are shares too.
Unit = Literal["1", "%", "times", "points", "motions", "poses", ""]


class _AsSaved:
    """Records that are equal where their files are: what is not finite is one and the same there, and equals itself."""

    def _as_saved(self) -> tuple[object, ...]:
        return tuple(_finite_or_none(value) for value in vars(self).values())

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._as_saved() == other._as_saved()

    def __hash__(self) -> int:
        return hash(self._as_saved())


def _finite_or_none(value: object) -> object:
    if isinstance(value, tuple):
        return tuple(map(_finite_or_none, value))
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclasses.dataclass(frozen=True, eq=False)
class Check(_AsSaved):
    """A question of the verdict with its figure, whether it speaks against the pose or not."""

    code: Code  # Of the reason that it would be
    question: str  # What is asked, in words
    value: float  # Figure, a share where the unit is "1"; NaN where it was not asked for
    relation: Relation  # How a figure that passes stands to the limit
    limit: float
    unit: Unit
    passed: bool | None  # Whether it does not speak against the pose; None where it was not asked


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Whether the pose may be trusted, and why."""

    level: Level  # What to do with the pose: use it, look at it, throw it away
    reasons: tuple[Reason, ...]  # Sentences, the weightiest first; each has a `code`
    checks: tuple[Check, ...] = dataclasses.field(
        default_factory=tuple, repr=False
    )  # Every question with its figure; none where nothing was found, or of a file of old
    # Probability that the pose is right, see `dqreg.trust.confidence`; NaN where it is not known
    confidence: float = dataclasses.field(default=math.nan, compare=False)
    # Figures by name that it was computed from; none where it is not known, or of a file
    _figures: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        reasons = tuple(reason if isinstance(reason, Reason) else Reason(reason) for reason in self.reasons)
        object.__setattr__(self, "reasons", reasons)
        if callable(self.checks):
            # In tracking nobody reads thirty questions a frame.
            remember(self, _checks=self.checks)
            object.__delattr__(self, "checks")

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> tuple[Check, ...]:
            if name != "checks" or remembered(self, "_checks") is None:
                raise AttributeError(name)
            return made_once(self, "checks", self._checks)

    @staticmethod
    def asking(
        level: Level,
        reasons: tuple[Reason, ...],
        checks: Callable[[], tuple[Check, ...]],
        confidence: float,
        figures: Mapping[str, float],
    ) -> Verdict:
        """A verdict whose checks are made when they are first read, by a function that can be pickled.

        Beside its confidence it keeps the figures that this was computed from.
        """
        verdict = Verdict(level, reasons, checks, confidence)  # type: ignore[arg-type]
        return remember(verdict, _figures=figures)

    @property
    def codes(self) -> tuple[Code | Literal[""], ...]:
        """Code of each reason."""
        return tuple(reason.code for reason in self.reasons)

    def doubted(self, doubt: Reason) -> Verdict:
        """The verdict with one more doubt, before the others; one that failed stays as it is."""
        if self.level == "failed":
            return self
        return self.saying("suspect", (doubt, *(reason for reason in self.reasons if reason.code != "accepted")))

    def _remarked(self, remark: Reason) -> Verdict:
        """The same with a remark behind its reasons."""
        reasons, checks = (*self.reasons, remark), functools.partial(getattr, self, "checks")
        return Verdict.asking(self.level, reasons, checks, self.confidence, self._figures)

    def saying(self, level: Level, reasons: tuple[Reason, ...]) -> Verdict:
        """The same questions, asked when they are first read, with another level, other reasons and no confidence."""
        return Verdict.asking(level, reasons, functools.partial(getattr, self, "checks"), math.nan, {})


@dataclasses.dataclass(frozen=True, eq=False)
class Direction(_AsSaved):
    """One of six independent motions of the part, and how firmly the matches hold it.

    A file of old has the words only: kind None, axis and point NaN.
    """

    strength: float  # 1 would be all pairs working against this motion with the longest lever; 0 is free
    # Standard deviation of the pose along it, as the largest displacement on the part; NaN where it is free
    sigma: float
    words: str  # The motion in words
    kind: Kind | None = None  # A rotation about the axis, or a translation along it
    axis: Vector = UNKNOWN  # Unit vector, target frame; its largest component is positive
    point: Vector = UNKNOWN  # A point of the axis, target frame

    @property
    def is_free(self) -> bool:
        """Whether the matches leave it unconstrained."""
        return math.isnan(self.sigma)


@dataclasses.dataclass(frozen=True)
class Alternative:
    """Another pose that explains the scan about as well."""

    T_target_source: FloatArray  # (4, 4): The pose
    score: float  # Truncated root mean square distance of the scan under it, target units; the smaller the better
    # The symmetry of the part that leads to it from the answer, in words; "" where it is another pose altogether
    symmetry: str = ""
    # Mean log-likelihood of a point that it gains over the answer, below 0 where it explains less, and the standard
    # error of that; NaN in a file of old
    gain: float = math.nan
    gain_sigma: float = math.nan
    # Where it is, seen from the answer: "one period (20 mm) along (1.00, 0.00, 0.00)"; "" in a file of old
    words: str = ""
    # Whether such a symmetry leads to it, so that it is right as well; of a file there are its words alone
    _symmetric: dataclasses.InitVar[bool | None] = None
    _is_symmetric: ClassVar[bool]

    def __post_init__(self, _symmetric: bool | None) -> None:
        remember(self, _is_symmetric=bool(self.symmetry) if _symmetric is None else _symmetric)
        lock(self)
