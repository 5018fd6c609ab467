"""A stand-in for the paper's "Feeder", whose coordinates are not printed.

The paper gives 32 vertices, 50 surfaces, 48 edges and a size of 322 x 84 x 151 units. For a simple polyhedron Euler
asks for vertices - edges + surfaces = 2, and 32 - 48 + 50 is 34. With three edges at every vertex 32 vertices have
exactly 48 edges, and then there are 18 surfaces (32 + 18 = 50): 50 looks like a slip.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray

SIZE = (322.0, 84.0, 151.0)
DIAGONAL = float(np.linalg.norm(SIZE))
CENTRE = np.array(SIZE) / 2.0

# Outlines (x, y) of the two prisms, each a rectangle with a step at both ends, and the heights between which they
# stand. Taken apart, two such prisms have 32 vertices, 48 edges and 20 surfaces.
_LOWER = [(0, 0), (322, 0), (322, 52), (236, 52), (236, 84), (78, 84), (78, 52), (0, 52)]
_UPPER = [(34, 11), (255, 11), (255, 46), (201, 46), (201, 71), (109, 71), (109, 46), (34, 46)]
_HEIGHTS = ((0.0, 88.0), (88.0, 151.0))


def feeder_vertices() -> FloatArray:
    """Vertices of two stacked stepped prisms in the box of the paper's object.

    Shapes: returns (32, 3).
    """
    rings = [
        (*corner, height)
        for outline, heights in zip((_LOWER, _UPPER), _HEIGHTS, strict=True)
        for height in heights
        for corner in outline
    ]
    return np.array(rings, dtype=np.float64)
