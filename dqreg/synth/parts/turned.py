"""Parts about an axis: flange with bolt holes and gear, both symmetric under rotations by one bolt or tooth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.synth.parts.patches import annulus, collar, ladder, lift, require_count, require_order, walls, weld
from dqreg.synth.parts.plain import Mesh, require_positive

# Half width of the cell around a bolt hole, in diameters of the hole, and the least number of the cell's facets.
_CELL_DIAMETERS, _CELL_FACETS = 0.75, 4


def flange(
    *,
    diameter: float = 120.0,
    thickness: float = 14.0,
    hub_diameter: float = 58.0,
    hub_height: float = 22.0,
    bore_diameter: float = 36.0,
    bolt_circle: float = 92.0,
    bolt_diameter: float = 11.0,
    bolts: int = 6,
    segments: int = 16,
) -> Mesh:
    """Round flange with a hub on one side, a bore and bolt holes: n-fold symmetric about z.

    The disc lies on z = 0 and is centred on the z axis, the hub stands on it, one bolt hole lies on the x axis.
    """
    require_positive(**{n: v for n, v in locals().items() if n not in ("bolts", "segments")})
    require_count("bolts", bolts, 3, most=200)
    require_count("segments", segments, 8, multiple=4)
    require_order(bore_diameter=bore_diameter, hub_diameter=hub_diameter, bolt_circle=bolt_circle, diameter=diameter)
    w, r_bolt, step = _CELL_DIAMETERS * bolt_diameter, 0.5 * bolt_circle, 2.0 * np.pi / bolts
    inside, outside = r_bolt - w, r_bolt + w
    if 2 * inside <= hub_diameter or 2 * outside >= diameter or w >= 0.9 * r_bolt * np.sin(step / 2):
        raise InputError.of(
            f"({bolt_diameter:g}) is too large for {bolts} holes on bolt_circle {bolt_circle:g} between hub_diameter "
            f"{hub_diameter:g} and diameter {diameter:g}; a hole needs a quarter of its diameter around",
            name="bolt_diameter",
        )
    sector, facets = _sector(float(np.arcsin(w / r_bolt)), step, segments)
    angles = (step * np.arange(bolts)[:, None] + sector).ravel()
    bore, hub, low, high, rim = (
        polar(r, angles) for r in (0.5 * bore_diameter, 0.5 * hub_diameter, inside, outside, 0.5 * diameter)
    )
    holes = [_hole(r_bolt, bolt_diameter, k * step, segments) for k in range(bolts)]
    ring = _bolt_ring(low, high, holes, facets)
    top = thickness + hub_height
    return weld(
        [
            *(lift(band, 2, thickness) for band in (annulus(low, hub), ring, annulus(rim, high))),
            *(lift(band, 2, 0.0, outward=-1) for band in (annulus(low, bore), ring, annulus(rim, high))),
            lift(annulus(hub, bore), 2, top),
            walls(hub, 2, (thickness, top)),
            walls(rim, 2, (0.0, thickness)),
            walls(bore, 2, (0.0, top), outward=-1),
            *(walls(hole, 2, (0.0, thickness), outward=-1) for hole in holes),
        ]
    )


def gear(
    *,
    teeth: int = 18,
    module: float = 4.0,
    thickness: float = 16.0,
    bore_diameter: float = 20.0,
    hub_diameter: float = 36.0,
    hub_height: float = 10.0,
    flank_facets: int = 5,
) -> Mesh:
    """Spur gear with involute flanks and a hub on one side: n-fold symmetric about z.

    The wheel lies on z = 0, the middle of one tooth is on the x axis. The pressure angle is 20 degrees, the teeth reach
    one module above the pitch circle and 1.25 modules below; there is no undercut, below the base circle the flank goes
    on along the radius.
    """
    require_positive(**{n: v for n, v in locals().items() if n not in ("teeth", "flank_facets")})
    require_count("teeth", teeth, 8, most=500)
    require_count("flank_facets", flank_facets, 1, most=200)
    require_order(bore_diameter=bore_diameter, hub_diameter=hub_diameter, root_diameter=module * (teeth - 2.5))
    radius, half = _flank(teeth, module, flank_facets)
    middles = 2.0 * np.pi / teeth * np.arange(teeth)[:, None]
    right, left = polar(radius, middles - half), polar(radius, middles + half)
    gap = polar(radius[0], middles + np.pi / teeth)
    outline = np.concatenate([right, left[:, ::-1], gap], axis=1).reshape(-1, 2)
    root = np.concatenate([right[:, :1], left[:, :1], gap], axis=1).reshape(-1, 2)
    angles = (middles + np.array([-half[0], half[0], np.pi / teeth])).ravel()
    bore, hub = polar(0.5 * bore_diameter, angles), polar(0.5 * hub_diameter, angles)
    tooth = np.concatenate([ladder(a, b) for a, b in zip(left, right, strict=True)])
    top = thickness + hub_height
    return weld(
        [
            *(lift(band, 2, thickness) for band in (annulus(root, hub), tooth)),
            *(lift(band, 2, 0.0, outward=-1) for band in (annulus(root, bore), tooth)),
            lift(annulus(hub, bore), 2, top),
            walls(outline, 2, (0.0, thickness)),
            walls(hub, 2, (thickness, top)),
            walls(bore, 2, (0.0, top), outward=-1),
        ]
    )


def polar(radius: ArrayLike, angle_rad: ArrayLike) -> FloatArray:
    """Make points of a plane from radius and angle. Shapes: returns (..., 2)."""
    length = np.asarray(radius, dtype=np.float64)
    return np.stack(np.broadcast_arrays(length * np.cos(angle_rad), length * np.sin(angle_rad)), axis=-1)


def _sector(half_cell: float, step: float, segments: int) -> tuple[FloatArray, int]:
    """Angles of one bolt's section of the circles, first the cell around the hole; and the facets of that cell."""
    facets = max(_CELL_FACETS, round(2.0 * half_cell * segments / (2.0 * np.pi)))
    rest = step - 2.0 * half_cell
    count = max(1, round(rest * segments / (2.0 * np.pi)), round(rest / (2.0 * half_cell / facets)))
    between = np.linspace(half_cell, step - half_cell, count + 1)
    return np.concatenate([np.linspace(-half_cell, half_cell, facets + 1), between[1:-1]]), facets


def _hole(r_bolt: float, diameter: float, angle_rad: float, segments: int) -> FloatArray:
    around = angle_rad + np.arange(segments) * (2.0 * np.pi / segments)
    corners = polar(0.5 * diameter, around)
    return polar(r_bolt, angle_rad) + corners


def _bolt_ring(low: FloatArray, high: FloatArray, holes: list[FloatArray], facets: int) -> FloatArray:
    """The band that holds the bolt holes, between two circles with the same angles."""
    per_bolt = len(low) // len(holes)
    bands = []
    for k, hole in enumerate(holes):
        cell = (k * per_bolt + np.arange(facets + 1)) % len(low)
        rest = (k * per_bolt + np.arange(facets, per_bolt + 1)) % len(low)
        bands.append(collar(np.concatenate([high[cell], low[cell[::-1]]]), hole))
        bands.append(ladder(low[rest], high[rest]))
    return np.concatenate(bands)


def _flank(teeth: int, module: float, facets: int) -> tuple[FloatArray, FloatArray]:
    """Radii along a flank from the root to the tip, and half the tooth's angle at each."""
    pitch = 0.5 * module * teeth
    base, root, tip = pitch * np.cos(np.deg2rad(20.0)), pitch - 1.25 * module, pitch + module
    radius = np.linspace(max(base, root), tip, facets + 1)
    radius = radius if root >= base else np.concatenate([[root], radius])
    pressure = np.arccos(np.minimum(1.0, base / radius))
    involute = np.tan(pressure) - pressure
    at_pitch = np.tan(np.deg2rad(20.0)) - np.deg2rad(20.0)
    return radius, np.pi / (2 * teeth) + at_pitch - involute
