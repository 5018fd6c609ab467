"""What a chunk of a scan says at a pose, in a few hundred numbers that add up over chunks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dqreg.arrays import FloatArray

if TYPE_CHECKING:
    from dqreg.geometry import Scan, Surface
    from dqreg.icp import InlierMixture


@dataclasses.dataclass(frozen=True)
class Sums:
    """What a chunk says at a pose; sums of several chunks are the sums of all.

    Attributes
    ----------
    matrix : ndarray, (13, 13)
        Quadratic form of its points to their planes, see `QuadraticForm`.
    weight, squared : float
        Sum of the weights, and of weights times squared distances.
    cost : float
        Sum of the robust cost.
    near, pairs, points : int
        Points within the largest distance, with a weight, and all.
    faces : ndarray, (2, k)
        How the points scatter on faces that look the same way, see `dqreg.icp.face_noise.face_sums`.
    """

    matrix: FloatArray
    weight: float
    squared: float
    cost: float
    near: int
    pairs: int
    points: int
    faces: FloatArray

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(getattr(self, field.name) + getattr(other, field.name) for field in dataclasses.fields(self)))


@dataclasses.dataclass(frozen=True)
class Question:
    """What is asked of every chunk in a step.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Pose between the centred frames.
    mixture : InlierMixture
        Kernel of the distances.
    angle_rad : float
        Largest angle between normals, where both are known.
    origins : pair of ndarray, (3,)
        Of the quadratic form, the same for all chunks.
    faces : ndarray, (2, k), or None
        Sums of all chunks by which the faces are weighed; None weighs them alike.
    """

    T_target_source: FloatArray
    mixture: InlierMixture
    angle_rad: float
    origins: tuple[FloatArray, FloatArray]
    faces: FloatArray | None = None


def measure(scan: Scan, surface: Surface, question: Question) -> Sums:
    """Sums of a chunk at a pose.

    Parameters
    ----------
    scan : Scan
        Points of the chunk.
    surface : Surface
        The target, whole.
    question : Question
        Pose, kernel and origins.

    Returns
    -------
    Sums
        To be added to those of other chunks.
    """
    from dqreg.icp import NormalAngle, WithinDistance, correspond
    from dqreg.icp.face_noise import face_sums, precisions_at
    from dqreg.icp.weights import product
    from dqreg.solvers.quadratic import plane_form

    mixture = question.mixture
    pairs = correspond(scan, surface, question.T_target_source)
    distances = pairs.distances
    gate = product((WithinDistance(mixture.limit), NormalAngle(question.angle_rad)), pairs)
    weights = gate * mixture.weight(distances)
    used = (weights > 0.0) & pairs.closest.normals.any(axis=1)
    closest = pairs.closest
    normals, held = closest.normals[used], weights[used]
    if question.faces is not None:
        held = held * precisions_at(normals, question.faces)
    return Sums(
        plane_form(scan.points[used], closest.points[used], normals, held, question.origins),
        float(weights.sum()),
        float(weights @ distances**2),
        float(mixture.cost(np.where(gate > 0.0, distances, mixture.limit)).sum()),
        int(np.count_nonzero(gate)),
        int(np.count_nonzero(weights)),
        len(distances),
        face_sums(normals, pairs.aside[used], weights[used]),
    )


def split(scan: Scan, chunks: int) -> list[Scan]:
    """Runs of a scan along the Morton curve, so that each is a patch of the surface.

    Parameters
    ----------
    scan : Scan
        All points.
    chunks : int
        How many; fewer where there are fewer points.

    Returns
    -------
    list of Scan
        Every point in exactly one.
    """
    return [scan.taken(rows) for rows in np.array_split(np.arange(len(scan)), min(chunks, len(scan)))]


def total(parts: Sequence[Sums]) -> Sums:
    """Sums of all chunks, always added in the same order.

    Parameters
    ----------
    parts : sequence of Sums
        One at least.

    Returns
    -------
    Sums
        Of the whole scan.
    """
    whole = parts[0]
    for part in parts[1:]:
        whole = whole + part
    return whole
