"""Steps of an alignment in a plan: what is laid on what, with which weights, bands and locked motions."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.plan.keys import FaceName, faces_of_list, number_of, require_known, require_one_of, triple_of
from dqreg.inspection.plan.tolerances import SIDES, sides_of
from dqreg.solvers.dof import Freedom

StepKind = Literal["best-fit", "tolerance", "minimax", "outside", "inside", "datums", "points"]
KEYS = ("name", "kind", "faces", "weights", *SIDES, "dof", "points", "prior")
# No half turn is more than that, degrees.
HALF_TURN_DEG = 180.0


@dataclasses.dataclass(frozen=True)
class PlannedPrior:
    """How well the pose before a step is known: standard deviations about the axes of the part, through its middle."""

    rotation_deg: tuple[float, float, float]
    translation: tuple[float, float, float]

    def covariance(self, by: FloatArray) -> FloatArray:
        """Of the increment about a point that lies ``by`` from the part's middle, (6, 6): rotation first."""
        own = np.diag(np.r_[np.deg2rad(self.rotation_deg), self.translation] ** 2)
        # A turn about the middle moves the point as well.
        x, y, z = by
        moves = np.eye(6)
        moves[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        return np.asarray(moves @ own @ moves.T)


@dataclasses.dataclass(frozen=True)
class PlannedStep:
    """One step of an alignment."""

    name: str
    kind: StepKind
    faces: tuple[FaceName, ...] = ()  # Those that count; none: all
    weights: tuple[float, ...] = ()  # Of each of them; none: 1
    band: tuple[float, float] | None = None  # Signed deviations allowed, outside the part positive
    dof: str = "all"  # Degrees of freedom away from the step before
    # Reference points: place on the part and, where given, the direction that it counts along
    points: tuple[tuple[float, ...], ...] = ()
    prior: PlannedPrior | None = None  # None: nothing is known of the pose


def steps_of(entries: list[Any], letters: list[str], name: str) -> tuple[PlannedStep, ...]:
    """The steps of `[[alignment]]`, in their order."""
    return tuple(_step(entry, letters, f"{name}: alignment {k + 1}") for k, entry in enumerate(entries))


def _step(entry: Any, letters: list[str], where: str) -> PlannedStep:
    require_known(entry, KEYS, where)
    kind = entry.get("kind")
    require_one_of(kind, get_args(StepKind), f"{where}: kind")
    if kind == "datums" and not letters:
        raise InputError(f'{where}: kind = "datums" needs [[datum]] entries')
    band = None
    if any(key in entry for key in SIDES):
        plus, minus = sides_of(entry, where)
        band = (-minus, plus)
    if kind == "tolerance" and band is None:
        raise InputError(f"{where}: a tolerance fit needs tolerance, or plus and minus")
    faces = faces_of_list(entry.get("faces", []), where)
    if faces and kind in ("datums", "points"):
        raise InputError(f"{where}: faces do not go with kind = {kind!r}")
    return PlannedStep(
        name=str(entry.get("name", kind)),
        kind=kind,
        faces=faces,
        weights=_weights(entry.get("weights", []), len(faces), where),
        band=band,
        dof=_dof(entry.get("dof", "all"), where),
        points=_points(entry.get("points", []), kind, where),
        prior=_prior(entry["prior"], where) if "prior" in entry else None,
    )


def _weights(given: Any, count: int, where: str) -> tuple[float, ...]:
    if not isinstance(given, list) or len(given) not in (0, count):
        raise InputError(f"{where}: weights is a list of as many numbers as faces; got {given!r:.60}")
    weights = tuple(number_of({"weights": each}, "weights", where) for each in given)
    if any(weight <= 0.0 for weight in weights):
        raise InputError(f"{where}: weights are above 0; leave a face out instead; got {given!r:.60}")
    return weights


def _prior(given: Any, where: str) -> PlannedPrior:
    require_known(given, ("rotation", "translation"), f"{where}: prior")
    found = []
    for key in ("rotation", "translation"):
        if key not in given:
            raise InputError(f"{where}: prior needs rotation, degrees, and translation, a length: standard deviations")
        three = given[key] if isinstance(given[key], list) else [given[key]] * 3
        sigma = triple_of({key: three}, key, f"{where}: prior")
        if min(sigma) <= 0.0 or (key == "rotation" and max(sigma) > HALF_TURN_DEG):
            most = f" and at most {HALF_TURN_DEG:g}" if key == "rotation" else ""
            raise InputError(
                f"{where}: prior: {key} is one or three standard deviations above 0{most}, got {given[key]!r:.60}; "
                "what may not move at all is locked by dof"
            )
        found.append(sigma)
    return PlannedPrior(*found)


def _dof(given: Any, where: str) -> str:
    if not isinstance(given, str):
        raise InputError(f'{where}: dof is text such as "tz rx ry"; got {given!r:.60}')
    try:
        Freedom.parse(given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return given


def _points(given: Any, kind: str, where: str) -> tuple[tuple[float, ...], ...]:
    if (kind == "points") != bool(given) or not isinstance(given, list):
        raise InputError(f'{where}: points = [[x, y, z], ...] goes with kind = "points", and only with it')
    for each in given:
        if not isinstance(each, list) or len(each) not in (3, 6):
            raise InputError(
                f"{where}: a point is [x, y, z], or [x, y, z, dx, dy, dz] with its direction; got {each!r:.60}"
            )
        if len(each) == 6 and not any(each[3:]):
            raise InputError(f"{where}: the direction of a point must not be of length zero; got {each!r:.60}")
    return tuple(tuple(number_of({"points": x}, "points", where) for x in each) for each in given)
