"""The bracket: a milled part with a flat base, a wall, rounds of four sizes and a fillet."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.synth.parts.patches import annulus, circle, fan, grid, lift, ring, walls, weld
from dqreg.synth.parts.plain import Mesh, four_holes, require_positive


def bracket(
    *,
    length: float = 120.0,
    width: float = 80.0,
    height: float = 60.0,
    base_thickness: float = 10.0,
    wall_thickness: float = 12.0,
    fillet_radius: float = 10.0,
    large_hole: float = 16.0,
    small_hole: float = 9.0,
    boss_diameter: float = 28.0,
    boss_height: float = 10.0,
    bore_diameter: float = 14.0,
    boss_position: float = 0.4,
    segments: int = 48,
) -> Mesh:
    """L-bracket without symmetry: base with four holes, wall with a bored boss, fillet between them.

    The base lies on z = 0 with one corner at the origin, the wall stands on x = 0, and the boss looks along +x.
    """
    require_positive(**{name: value for name, value in locals().items() if name != "segments"})
    if bore_diameter >= boss_diameter:
        wanted = f"({bore_diameter:g}) must be smaller than boss_diameter ({boss_diameter:g})"
        raise InputError.of(wanted, name="bore_diameter")
    foot, rise = wall_thickness + fillet_radius, base_thickness + fillet_radius
    if foot >= length or rise >= height:
        raise InputError(
            f"wall, base and fillet_radius take up {foot:g} of length {length:g} and {rise:g} of height "
            f"{height:g}; both must leave a flat part"
        )
    x, y = [foot, 0.5 * (foot + length), length], [0.0, 0.5 * width, width]
    centre = (boss_position * width, 0.5 * (rise + height))
    boss = circle(centre, boss_diameter, segments)
    bore = circle(centre, bore_diameter, segments)
    tip = wall_thickness + boss_height
    arc = _fillet((base_thickness, wall_thickness), fillet_radius, segments // 4)
    return weld(
        [
            *_base(x, y, base_thickness, (large_hole, small_hole), segments),
            *_web(arc, y, height, wall_thickness),
            lift(ring((0.0, width), (0.0, height), bore), 0, 0.0, outward=-1),
            lift(ring((0.0, width), (rise, height), boss), 0, wall_thickness),
            walls(boss, 0, (wall_thickness, tip)),
            lift(annulus(boss, bore), 0, tip),
            walls(bore, 0, (0.0, tip), outward=-1),
        ]
    )


def _base(
    x: list[float], y: list[float], top: float, diameters: tuple[float, float], segments: int
) -> list[FloatArray]:
    """Faces of the base beyond the foot of the fillet, and the whole underside; x, y: lines of the cells."""
    face, holes = four_holes(x, y, diameters, segments)
    # Under the wall the underside takes up the middle vertex of the cells, so that the back needs none.
    strip = fan([[0.0, y[0]], [x[0], y[0]], [x[0], y[1]], [x[0], y[2]], [0.0, y[2]]])
    ends = grid([0.0, top], x)
    return [
        lift(face, 2, top),
        lift(np.concatenate([face, strip]), 2, 0.0, outward=-1),
        lift(grid(y, [0.0, top]), 0, x[2]),
        lift(ends, 1, y[0], outward=-1),
        lift(ends, 1, y[2]),
        *(walls(hole, 2, (0.0, top), outward=-1) for hole in holes),
    ]


def _web(arc: FloatArray, y: list[float], height: float, thickness: float) -> list[FloatArray]:
    """Fillet, top of the wall, and the end faces of both; arc: (z, x) from the wall to the base."""
    corner = np.array([[0.0, 0.0], [height, 0.0], [height, thickness], *arc, [0.0, arc[-1, 1]]])
    (za, xa), (zb, xb) = arc[-2], arc[-1]
    # The last facet meets the base's cells, which have a vertex in the middle of that edge.
    last = fan([[xa, y[0], za], [xb, y[0], zb], [xb, y[1], zb], [xb, y[2], zb], [xa, y[2], za]])
    return [
        walls(arc[:-1], 1, (y[0], y[2]), closed=False),
        last,
        lift(grid([0.0, thickness], [y[0], y[2]]), 2, height),
        lift(fan(corner), 1, y[0], outward=-1),
        lift(fan(corner), 1, y[2]),
    ]


def _fillet(corner: tuple[float, float], radius: float, facets: int) -> FloatArray:
    """Quarter circle (z, x) in the inner corner, from the wall to the base."""
    angle = np.linspace(np.pi, 1.5 * np.pi, facets + 1)
    # The ends are set exactly: wall and base share these vertices.
    arc = np.add(corner, radius) + radius * np.column_stack([np.sin(angle), np.cos(angle)])
    arc[0] = corner[0] + radius, corner[1]
    arc[-1] = corner[0], corner[1] + radius
    return arc
