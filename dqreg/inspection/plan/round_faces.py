"""How far a cylinder of a part goes round: fillets are cylinders too, that no drawing gives a diameter or a place."""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.geometry.angles import gaps_around
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection.part_faces import Face

# A cylinder is closed where no corners are farther apart about its axis.
OPEN_GAP_RAD = 0.5 * math.pi
# Half a turn, as files give the halves of a hole, and what their rounding adds.
HALF_TURN_RAD = math.pi + 0.01


def is_arc(mesh: Mesh, face: Face) -> bool:
    """Whether a cylinder covers less than half a turn, as a fillet: its size and place are not well told."""
    return _gap(_local(mesh, face)) > HALF_TURN_RAD


def slender(mesh: Mesh, face: Face) -> float:
    """Length of a cylinder in diameters; 0 of one that is not closed, as a fillet."""
    assert face.feature is not None
    local = _local(mesh, face)
    return float(np.ptp(local[:, 2])) / face.feature.diameter if _gap(local) < OPEN_GAP_RAD else 0.0


def _local(mesh: Mesh, face: Face) -> FloatArray:
    """Corners of a cylinder in its own frame, z along the axis. Shape: (n, 3)."""
    assert face.feature is not None
    corners = mesh.corners[faces_of(mesh)[1] == face.number].reshape(-1, 3)
    return np.asarray((corners - face.feature.point) @ face.feature.frame)


def _gap(local: FloatArray) -> float:
    return float(gaps_around(np.arctan2(local[:, 1], local[:, 0]))[1].max())
