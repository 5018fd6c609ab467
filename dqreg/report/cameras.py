"""Where the part is looked at from: the same named views in the pictures and in the interactive view."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError

# Yaw about z and pitch above the horizon, degrees; at (0, 0) one looks along +y, with x to the right and z up.
VIEWS: dict[str, tuple[float, float]] = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
    "iso": (35.0, 30.0),
    "iso-right": (125.0, 30.0),
    "iso-back": (215.0, 30.0),
    "iso-left": (305.0, 30.0),
    "iso-below": (35.0, -30.0),
    "iso-below-back": (215.0, -30.0),
}
# The corner from which most of the scan is seen; needs the scan, so it has no angles of its own.
BEST = "best"
CORNERS = tuple(name for name in VIEWS if name.startswith("iso"))


def camera(yaw_deg: float, pitch_deg: float) -> FloatArray:
    """Axes of a view. Shapes: returns (3, 3)."""
    yaw, pitch = np.deg2rad([yaw_deg, pitch_deg])
    right = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    towards = np.array([np.cos(pitch) * np.sin(yaw), -np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    # Zeros become plain zeros, so that views along the axes are exact.
    axes: FloatArray = np.stack([right, np.cross(towards, right), towards]) + 0.0
    return axes


def best_corner(normals: FloatArray) -> str:
    """The corner view that most of the scanned surface faces.

    >>> best_corner(np.array([[0.0, -1.0, 0.2]] * 3))
    'iso'
    """
    seen = [np.maximum(normals @ camera(*VIEWS[name])[2], 0.0).sum() for name in CORNERS]
    # A corner from below must be clearly better: parts are drawn from above.
    weights = np.where(["below" in name for name in CORNERS], 0.9, 1.0)
    # Without normals all are alike, and the first is taken.
    return CORNERS[int(np.argmax(np.array(seen) * weights))]


def angles_of(name: str) -> tuple[float, float]:
    """Yaw and pitch of a view: one of `VIEWS`, or the two numbers themselves, in degrees.

    >>> angles_of("top"), angles_of("12.5/-30")
    ((0.0, 90.0), (12.5, -30.0))
    """
    if name in VIEWS:
        return VIEWS[name]
    yaw, _, pitch = name.partition("/")
    return float(yaw), float(pitch)


def require_view(name: str) -> str:
    """A view's name, checked."""
    if name != BEST and name not in VIEWS:
        raise InputError(f"unknown view {name!r}; known are {', '.join((BEST, *VIEWS))}")
    return name
