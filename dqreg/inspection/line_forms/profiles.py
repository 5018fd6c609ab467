"""Profiles of a scanned face: its distances from the fitted shape along one line of it, from a strip of its points."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.features import Feature
from dqreg.inspection.features.models import distances
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part.scanned_part import ScannedPart

# Points that a profile needs: forty neighbourhoods of five, whose medians bear two outliers.
WANTED_PROFILE_POINTS = 200
# Its strip is so many spacings of the scan wide to each side at least, else that share of the face at most.
MIN_HALF_WIDTH_SPACINGS, MAX_HALF_WIDTH_SHARE = 1.5, 0.1
# Steps to the centre of a section: it is nearly there.
CENTRING_STEPS = 4
# Points without which there is no profile.
MIN_PROFILE_POINTS = 8

Place = tuple[float, float, float]
Where = TypeVar("Where")
Made = TypeVar("Made")


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """Distances of points along a line of a face."""

    along: FloatArray  # (n,): Angle in radians of a section, length of a straight line
    values: FloatArray  # (n,): Signed distance from the fitted shape, in the plane of the profile
    radius: float  # Of the fitted shape there; 0 of a straight line
    middle: FloatArray  # (3,): In the frame of the scanned part: where a label stands
    held: bool = False  # About an axis that is given: the zone has its centre there
    stretches: FloatArray | None = None  # (k, 2): Of a straight line, where the face is; None: all along it

    @property
    def places(self) -> FloatArray:
        """Neighbours along the profile are neighbours here, (n, 3)."""
        if not self.radius:
            return np.column_stack([self.along, np.zeros((len(self.along), 2))])
        across = self.radius * np.column_stack([np.cos(self.along), np.sin(self.along)])
        return np.column_stack([across, np.zeros(len(across))])

    @property
    def slopes(self) -> FloatArray:
        """Of the values by the place, and the tilt of the lines, of a zone that they lie in, (n, 2 or 3)."""
        one = np.ones(len(self.along))
        if self.held:
            return one[:, None]
        if not self.radius:
            return np.column_stack([one, self.along])
        return np.column_stack([one, np.cos(self.along), np.sin(self.along)])

    def centred(self) -> Profile:
        """The same section about the centre of its own circle, so that what is left of it is small."""
        if not self.radius or self.held:
            return self
        points, centre = (self.radius + self.values)[:, None] * self.slopes[:, 1:], np.zeros(2)
        for _ in range(CENTRING_STEPS):
            away = points - centre
            lengths = np.linalg.norm(away, axis=1)
            slopes = np.column_stack([np.ones(len(away)), away / lengths[:, None]])
            centre = centre + np.linalg.lstsq(slopes, lengths - self.radius, rcond=None)[0][1:]
        away = points - centre
        lengths = np.linalg.norm(away, axis=1)
        return dataclasses.replace(self, along=np.arctan2(away[:, 1], away[:, 0]), values=lengths - self.radius)

    def blocks(self, count: int) -> Profile:
        """Medians of as many blocks of neighbouring points."""
        order = np.array_split(np.argsort(self.along, kind="stable"), count)
        along, values = (
            np.array([f(each[rows]) for rows in order]) for f, each in ((np.mean, self.along), (np.median, self.values))
        )
        return dataclasses.replace(self, along=along, values=values)


@dataclasses.dataclass(frozen=True, eq=False)
class Unrolled:
    """Points of a cylinder or cone about its axis: turn, height, distance across it, radius of the shape there."""

    feature: Feature
    turn: FloatArray  # (n,): Radians
    height: FloatArray  # (n,)
    values: FloatArray  # (n,)
    radius: FloatArray  # (n,)
    ends: tuple[float, float]  # Heights between which the whole face lies


def unrolled(part: ScannedPart, face: Face) -> Unrolled:
    """The points of a cylinder or cone about the axis that is fitted to them."""
    feature = part.measured(face)
    points = part.on(face)
    local = (points - feature.point) @ feature.frame
    values, _ = distances(feature.kind, feature.shape, points)
    angle = feature.half_angle if feature.kind == "cone" else 0.0
    corners = part.mesh.corners[part.of_triangle == face.number].reshape(-1, 3)
    whole = (corners - feature.point) @ feature.axis
    return Unrolled(
        feature=feature,
        turn=np.arctan2(local[:, 1], local[:, 0]),
        height=local[:, 2],
        values=values / np.cos(angle),
        radius=feature.radius + np.tan(angle) * local[:, 2],
        ends=(float(whole.min()), float(whole.max())),
    )


def half_width(part: ScannedPart, face: Face, across: FloatArray) -> float:
    """Half the width of strips of a face that hold enough points, from where its points lie across them."""
    extent, count = float(np.ptp(across)), max(len(across), 1)
    spacing = float(np.sqrt(face.area * float(part.coverage()[face.number]) / count))
    wanted = 0.5 * WANTED_PROFILE_POINTS * extent / count
    return max(MIN_HALF_WIDTH_SPACINGS * spacing, min(wanted, MAX_HALF_WIDTH_SHARE * extent))


def spread_over(across: FloatArray, half: float, most: int) -> list[float]:
    """Middles of strips that lie beside each other, as many as there is room for."""
    low, high = float(across.min()), float(across.max())
    count = int(np.clip((high - low) / (2.0 * half), 1, most))
    return [low + (high - low) * (k + 0.5) / count for k in range(count)]


def require_points(face: Face, rows: IntArray, words: str) -> None:
    """`DegenerateGeometryError` where too few points lie on a profile."""
    if len(rows) < MIN_PROFILE_POINTS:
        raise DegenerateGeometryError(
            f"face {face.number} was not scanned there: {len(rows)} points lie on {words}, "
            f"{MIN_PROFILE_POINTS} are needed"
        )


def scanned_ones(make: Callable[[Where], Made], where: Iterable[Where]) -> list[Made]:
    """What is made of lines, where they were scanned: one that was not is left out, unless none was."""
    found, last = [], None
    for each in where:
        try:
            found.append(make(each))
        except DegenerateGeometryError as error:
            last = error
    if last is not None and not found:
        raise last
    return found


def require_kind(feature: Feature, wanted: Sequence[str], words: str) -> None:
    """`InputError` where a face has no such form."""
    if feature.kind not in wanted:
        raise InputError(f"a {feature.kind} {words}")


def words_of(place: Sequence[float] | FloatArray) -> str:
    """A place as it is written in a plan."""
    return "[" + ", ".join(f"{x:g}" for x in place) + "]"
