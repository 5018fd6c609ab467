"""How far round its axis a face goes on the part, and how far it was scanned."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.inspection.features import Feature
from dqreg.inspection.part_faces import Face
from dqreg.inspection.scanned_part import ScannedPart

# Share of the way round that must be seen: on less, form error is taken for another size and place, and no residual
# shows it. Bores with three lobes of 0.04 seen on 60 to 150 degrees had diameters off by ten uncertainties.
SEEN = 0.5


def require_around(part: ScannedPart, face: Face, kind: str) -> None:
    """`DegenerateGeometryError` where a round face was scanned on too little of its way round."""
    if face.feature is None or face.feature.kind not in ("cylinder", "cone"):
        return
    own = arc_deg(part.corners([face]), face.feature)
    seen = arc_deg(part.on(face), face.feature)
    if seen < SEEN * own:
        raise DegenerateGeometryError(
            f"face {face.number} was not scanned well enough: it is seen on {seen:.0f} of {own:.0f} degrees round its "
            f"axis, and at least half of them are needed for its {kind}: form error would be taken for size"
        )


def arc_deg(points: FloatArray, feature: Feature) -> float:
    """Degrees round an axis that points cover: a whole turn without the largest gap."""
    local = (points - feature.point) @ feature.frame
    turn = np.sort(np.arctan2(local[:, 1], local[:, 0]))
    return 360.0 - float(np.degrees(np.diff(np.r_[turn, turn[0] + 2.0 * np.pi]).max()))
