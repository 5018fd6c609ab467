"""Sums over pairs of discs: all that the plane-to-plane cost of two clouds is made of."""

from __future__ import annotations

from dqreg._arrays import FloatArray
from dqreg.kernels.compiling.compiled import compiled
from dqreg.kernels.steps.pose_forms import add_pair


@compiled
def disc_pair_sums(
    first: int,
    last: int,
    points: FloatArray,
    places: FloatArray,
    normals: FloatArray,
    own: FloatArray,
    turn: FloatArray,
    standing: FloatArray,
    moving: FloatArray,
    weights: FloatArray,
    origins: FloatArray,
    bend: float,
    factor: float,
    chunk: int,
    sums: FloatArray,
) -> None:
    """Write the sums over pairs first to last in the row of their chunk, see `plane_to_plane_form`. O(1) a pair.

    What the sums are of says `form_of_sums`. Shapes: points p, places q, their normals and the source's own (n, 3),
    these before a turn (3, 3); variances, to which that of a bend is added, and weights, times a factor, (n,), those of
    the places (0,) where they have none; origins (2, 3); sums (chunks, 73).
    """
    total = sums[first // chunk]
    # In names: elements of the array would be read again for every pair.
    xu, xv, xw, yu, yv, yw = turn[0, 0], turn[0, 1], turn[0, 2], turn[1, 0], turn[1, 1], turn[1, 2]
    zu, zv, zw = turn[2, 0], turn[2, 1], turn[2, 2]
    for i in range(first, last):
        half = 0.5 * factor * weights[i]
        if half == 0.0:
            continue
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        u, v, w = own[i, 0], own[i, 1], own[i, 2]
        mx, my, mz = xu * u + xv * v + xw * w, yu * u + yv * v + yw * w, zu * u + zv * v + zw * w
        spread = bend + (standing[i] if len(standing) else 0.0)
        a = 1.0 - min(max(spread, 0.0), 1.0) if nx != 0.0 or ny != 0.0 or nz != 0.0 else 0.0
        b = 1.0 - min(max(bend + moving[i], 0.0), 1.0) if mx != 0.0 or my != 0.0 or mz != 0.0 else 0.0
        c = nx * mx + ny * my + nz * mz
        lean = b * c / (2.0 - b)
        ux, uy, uz = nx + lean * mx, ny + lean * my, nz + lean * mz
        k = half * (a * (2.0 - b) / ((2.0 - a) * (2.0 - b) - a * b * c * c))
        g = half * (b / (2.0 - b))
        xx, yy, zz = (
            half + k * ux * ux + g * mx * mx,
            half + k * uy * uy + g * my * my,
            half + k * uz * uz + g * mz * mz,
        )
        xy, xz, yz = k * ux * uy + g * mx * my, k * ux * uz + g * mx * mz, k * uy * uz + g * my * mz
        p, q, r = points[i, 0] - origins[0, 0], points[i, 1] - origins[0, 1], points[i, 2] - origins[0, 2]
        x, y, z = places[i, 0] - origins[1, 0], places[i, 1] - origins[1, 1], places[i, 2] - origins[1, 2]
        sides = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
        at = add_pair((p, q, r), (xx, yy, zz, xy, xz, yz), sides, total)
        total[at] += x * sides[0] + y * sides[1] + z * sides[2]
