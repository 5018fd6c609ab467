"""The blade: a twisted, tapered aerofoil on a platform, with no flat face to hold on to but the platform's."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.synth.parts.patches import annulus, cap, fan, lift, loft, require_count, walls, weld
from dqreg.synth.parts.plain import Mesh, require_positive

# Where along the chord the sections are stacked, and half the blunt trailing edge over the chord.
_STACK_CHORDS, _TRAILING_CHORDS = 0.4, 0.01


def blade(
    *,
    chord: float = 46.0,
    height: float = 90.0,
    thickness: float = 0.13,
    camber: float = 0.08,
    taper: float = 0.6,
    twist_rad: float = float(np.deg2rad(35.0)),
    platform_length: float = 62.0,
    platform_width: float = 34.0,
    platform_height: float = 12.0,
    stations: int = 20,
    sections: int = 18,
) -> Mesh:
    """Turbine-like blade without symmetry.

    The platform is centred on the z axis between z = 0 and ``platform_height``; the aerofoil stands on it, its chord
    along x at the root, its sections stacked about the z axis.
    """
    require_positive(**{n: v for n, v in locals().items() if n not in ("stations", "sections", "twist_rad")})
    require_count("stations", stations, 4, most=500)
    require_count("sections", sections, 2, most=500)
    if not 0.0 <= twist_rad <= np.pi / 2:
        raise InputError.of("must lie between 0 and a right angle", name="twist_rad", given=twist_rad)
    if thickness > 0.4 or camber > 0.25 or taper > 1.0:
        raise InputError(
            f"thickness, camber and taper are at most 0.4, 0.25 and 1; got {thickness:g}, {camber:g}, {taper:g}"
        )
    upper, lower = _sides(thickness, camber, stations)
    root = chord * _loop(upper, lower)
    a, b = 0.5 * platform_length, 0.5 * platform_width
    if root[:, 0].min() <= -a or root[:, 0].max() >= a or np.abs(root[:, 1]).max() >= b:
        raise InputError.of(
            f"({chord:g}) is too long: the root does not fit onto platform_length {platform_length:g} by "
            f"platform_width {platform_width:g}",
            name="chord",
        )
    share = np.linspace(0.0, 1.0, sections + 1)
    solid = np.stack([_placed(root, s, taper, twist_rad, platform_height + s * height) for s in share])
    x = np.linspace(-a, a, stations)
    above, below = (np.column_stack([x, np.full(stations, side)]) for side in (b, -b))
    rim, tip = _loop(above, below, np.array([-a, 0.0])), solid[-1, :, :2]
    return weld(
        [
            loft(solid),
            lift(cap(tip[0], tip[:stations:-1], tip[1 : stations + 1]), 2, solid[-1, 0, 2]),
            lift(annulus(rim, solid[0, :, :2]), 2, platform_height),
            walls(rim, 2, (0.0, platform_height)),
            lift(_underside(rim[0], above, below), 2, 0.0, outward=-1),
        ]
    )


def _sides(thickness: float, camber: float, stations: int) -> tuple[FloatArray, FloatArray]:
    """Upper and lower side of a section of chord 1 behind its nose, which lies at (-_STACK_CHORDS, 0)."""
    x = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, stations + 1)[1:])
    # Jacobs, Ward and Pinkerton (1933), with the last coefficient that closes the trailing edge, then blunted.
    half = 0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4
    half, line = 5.0 * thickness * half + _TRAILING_CHORDS * x, 4.0 * camber * x * (1.0 - x)
    return np.column_stack([x - _STACK_CHORDS, line + half]), np.column_stack([x - _STACK_CHORDS, line - half])


def _loop(upper: FloatArray, lower: FloatArray, nose: FloatArray | None = None) -> FloatArray:
    """Nose, lower side to the back, upper side to the front: counter-clockwise."""
    nose = np.array([-_STACK_CHORDS, 0.0]) if nose is None else nose
    return np.concatenate([nose[None], lower, upper[::-1]])


def _underside(middle: FloatArray, above: FloatArray, below: FloatArray) -> FloatArray:
    """Rectangle with a vertex in the middle of its left side, from which the first cells are fanned out."""
    left = fan(np.stack([middle, below[0], below[1]])), fan(np.stack([middle, above[1], above[0]]))
    return np.concatenate([*left, cap(middle, above[1:], below[1:])])


def _placed(root: FloatArray, share: float, taper: float, twist_rad: float, z: float) -> FloatArray:
    """The root's section scaled, rotated and lifted to a fraction of the height."""
    c, s = np.cos(twist_rad * share), np.sin(twist_rad * share)
    turned = (1.0 - (1.0 - taper) * share) * root @ np.array([[c, s], [-s, c]])
    return np.column_stack([turned, np.full(len(root), z)])
