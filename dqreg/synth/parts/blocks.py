"""Parts of flat faces: regular prism, block with one notch, and the feeder's stand-in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.synth.parts.patches import annulus, fan, lift, require_count, require_order, walls, weld
from dqreg.synth.parts.plain import Mesh, require_positive, require_size
from dqreg.synth.parts.turned import polar


def prism(*, diameter: float = 60.0, height: float = 40.0, sides: int = 6) -> Mesh:
    """Regular prism, centred on the origin, axis along z: symmetric under 2 n turns.

    Shapes: vertices (2 sides, 3), faces (4 sides - 4, 3).
    """
    require_positive(diameter=diameter, height=height)
    require_count("sides", sides, 3)
    around = np.arange(sides) * (2.0 * np.pi / sides)
    outline, half = polar(0.5 * diameter, around), 0.5 * height
    return weld(
        [
            walls(outline, 2, (-half, half)),
            lift(fan(outline), 2, half),
            lift(fan(outline), 2, -half, outward=-1),
        ]
    )


def block(size: Sequence[float] = (80.0, 50.0, 30.0), *, notch: float = 6.0) -> Mesh:
    """Rectangular block with a cube cut out of one corner: but for that, it looks alike after three half-turns."""
    require_size(size)
    require_positive(notch=notch)
    require_order(notch=notch, size=min(size))
    lines = [np.array([-0.5 * s, 0.5 * s - notch, 0.5 * s]) for s in size]
    filled = np.ones((2, 2, 2), dtype=bool)
    filled[1, 1, 1] = False
    return weld(cells(lines, filled))


# The 1991 paper's "Feeder" has 32 vertices, 50 surfaces, 48 edges and a size of 322 x 84 x 151 units; its coordinates
# are not printed. For a simple polyhedron Euler asks for vertices - edges + surfaces = 2, and 32 - 48 + 50 is 34.
# With three edges at every vertex 32 vertices have exactly 48 edges, and then there are 18 surfaces (32 + 18 = 50):
# 50 looks like a slip. Outlines (x, y) of the two prisms that stand in for it, each a rectangle with a step at both
# ends; taken apart, two such prisms have 32 vertices, 48 edges and 20 surfaces.
FEEDER_SIZE = np.array([322.0, 84.0, 151.0])
FEEDER_DIAGONAL, FEEDER_CENTRE = float(np.linalg.norm(FEEDER_SIZE)), 0.5 * FEEDER_SIZE
_LOWER_XY = np.array([[0, 0], [322, 0], [322, 52], [236, 52], [236, 84], [78, 84], [78, 52], [0, 52]]) / 1.0
_UPPER_XY = np.array([[34, 11], [255, 11], [255, 46], [201, 46], [201, 71], [109, 71], [109, 46], [34, 46]]) / 1.0
_MIDDLE_Z, _TOP_Z = 88.0, 151.0


def feeder_vertices() -> FloatArray:
    """Vertices of the feeder's stand-in, ring by ring from the lowest, (32, 3)."""
    rings = ((_LOWER_XY, 0.0), (_LOWER_XY, _MIDDLE_Z), (_UPPER_XY, _MIDDLE_Z), (_UPPER_XY, _TOP_Z))
    return np.concatenate([np.column_stack([outline, np.full(len(outline), height)]) for outline, height in rings])


def feeder(*, scale: float = 1.0) -> Mesh:
    """Stand-in for the 1991 paper's "Feeder": two stacked prisms, 32 vertices in a box of 322 x 84 x 151, no symmetry.

    Shapes: vertices (32, 3), faces (60, 3).
    """
    require_positive(scale=scale)
    lower, upper, middle, top = scale * _LOWER_XY, scale * _UPPER_XY, scale * _MIDDLE_Z, scale * _TOP_Z
    return weld(
        [
            lift(_stepped(lower), 2, 0.0, outward=-1),
            walls(lower, 2, (0.0, middle)),
            lift(annulus(lower, upper), 2, middle),
            walls(upper, 2, (middle, top)),
            lift(_stepped(upper), 2, top),
        ]
    )


def _stepped(outline: FloatArray) -> FloatArray:
    """Triangles of a rectangle with a step at both ends: corners 3 to 6 are the narrow part."""
    return np.concatenate([fan(outline[[0, 1, 2, 3, 6, 7]]), fan(outline[3:7])])


def cells(lines: Sequence[FloatArray], filled: BoolArray) -> list[FloatArray]:
    """Boundary of the filled cells between three sets of parallel planes."""
    padded = np.pad(filled, 1)
    patches = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        order = np.moveaxis(padded, (axis, u, v), (0, 1, 2))
        step = np.diff(order.astype(int), axis=0)[:, 1:-1, 1:-1]
        for outward in (1, -1):
            for k, i, j in np.argwhere(step == -outward):
                (u0, u1), (v0, v1) = lines[u][i : i + 2], lines[v][j : j + 2]
                patch = fan([[u0, v0], [u1, v0], [u1, v1], [u0, v1]])
                patches.append(lift(patch, axis, lines[axis][k], outward=outward))
    return patches
