"""A registration under another alignment (datums, reference points, chosen faces); steps follow each other by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.rigid import pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.trust.records import Reason, Verdict

# A motion that an alignment leaves as it was has less than that share of its largest variance.
LEFT = 1e-12


class Alignment(Protocol):
    """What the alignments of `dqreg.inspection` have in common."""

    @property
    def T_target_source(self) -> FloatArray:
        """From the registered scan to the aligned one, in the target frame."""

    @property
    def covariance(self) -> FloatArray:
        """Of its left increment about the centre."""

    @property
    def centre(self) -> FloatArray:
        """In the target frame."""


def after_alignment(fields: Mapping[str, Any], alignment: Alignment, name: str) -> dict[str, Any]:
    """Fields of a `Registration` that change with one more step of alignment, see `Registration.aligned`."""
    if not name.strip():
        raise InputError("a step of an alignment needs a name")
    settings = fields["settings"]
    step = as_pose(alignment.T_target_source, "the alignment's pose")
    about = np.array(settings.get("centre", np.zeros(3)))
    record: dict[str, Any] = {"name": name, "T_target_source": step.tolist()}
    for key in ("goal", "constrained", "points", "rms", "largest", "share_within"):
        value = getattr(alignment, key, None)
        if isinstance(value, (str, int, float, dict)):
            record[key] = value
    steps = [*settings.get("alignments", ()), record]
    return {
        "T_target_source": step @ fields["T_target_source"],
        "covariance": _after(fields["covariance"], alignment, about),
        # An alignment leaves no motion open.
        "partial_information": None,
        "verdict": _verdict(fields["verdict"], alignment, name),
        "settings": {**settings, "alignments": steps},
    }


def _after(before: FloatArray, alignment: Alignment, centre: FloatArray) -> FloatArray:
    """What the alignment fixes is as uncertain as it says; what it leaves as it was, as uncertain as before."""
    arm = pose.from_parts(np.eye(3), alignment.centre - centre)
    carried = twist.adjoint(arm)
    spread = carried @ alignment.covariance @ carried.T
    # Rotations count by what they move at the arm that makes both parts of the covariance alike.
    turning, shifting = float(np.trace(spread[:3, :3])), float(np.trace(spread[3:, 3:]))
    lever = float(np.sqrt(shifting / turning)) if turning > 0.0 < shifting else 1.0
    scale = scaling_by(lever)
    variances, axes = np.linalg.eigh(spread * scale * scale[:, None])
    left = axes[:, variances <= LEFT * max(float(variances[-1]), 0.0)]
    if not left.shape[1] or not alignment.covariance.any():
        return spread
    kept = (left @ left.T) / scale[:, None] * scale
    total: FloatArray = spread + kept @ np.nan_to_num(before, nan=0.0) @ kept.T
    return 0.5 * (total + total.T)


def _verdict(verdict: Verdict, alignment: Alignment, name: str) -> Verdict:
    if getattr(alignment, "converged", True):
        return verdict
    sentence = f"the alignment {name!r} did not come to rest: its faces constrain the pose too weakly"
    return verdict.doubted(Reason(sentence, "not_converged"))
