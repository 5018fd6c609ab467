"""Faces that run smoothly through several surfaces, cut where their curvature changes: walls, arcs, fillets."""

from __future__ import annotations

import itertools

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray

# Normals of a wall or chamfer make one angle with an axis, to that sine (half a degree); they turn by more than that.
STRAIGHT_SIN = 8.7e-3
# Share of a face that a wall must be to be cut from its fillets, and how much longer it is there than their triangles.
MIN_WALL_SHARE, MIN_LENGTH_RATIO = 0.1, 3.0
# A face of which less is left beside a wall is that wall.
MIN_REST_SHARE = 8.7e-3
# Neighbouring corners of a profile are on one circle where the fourth is off that of three by less than that share of
# what the sides cut off; and all of an arc by as much.
ONE_CIRCLE = 0.2
# A profile of which less is arcs and single sides is of another shape, and stays whole.
MIN_KNOWN_SHARE = 0.7
# A whole circle: its corners may be off by that share of its size, or of what its sides cut off (rounded files).
CIRCLE_TOLERANCE, SAGITTA_TOLERANCE = 1e-4, 0.75
# How many times as wide as others a side may be.
MAX_SIDE_RATIO = 3.0


def cut_walls(links: IntArray, faces: IntArray, normals: FloatArray, areas: FloatArray, ends: FloatArray) -> BoolArray:
    """Which links between triangles of one face are between a wall and its fillets.

    Shapes: links (m, 2), faces (f,), normals (f, 3), areas (f,), ends of the side at each link (m, 2, 3).
    """
    along = _axes(faces, normals, areas)
    wall = np.abs(np.einsum("fki,fi->fk", along[faces], normals)) < STRAIGHT_SIN
    count = len(along)
    whole = np.bincount(faces, weights=areas, minlength=count)
    shares = np.stack([np.bincount(faces, weights=areas * wall[:, k], minlength=count) for k in range(3)], axis=1)
    best = np.argmax(shares, axis=1)
    share = shares[np.arange(count), best] / np.maximum(whole, 1e-300)
    is_cut = (share >= MIN_WALL_SHARE) & (share < 1.0 - MIN_REST_SHARE)
    of_wall = wall[np.arange(len(faces)), best[faces]] & is_cut[faces]
    rim = of_wall[links[:, 0]] != of_wall[links[:, 1]]
    inner = np.where(of_wall[links[:, 0]], links[:, 0], links[:, 1])
    outer = np.where(of_wall[links[:, 0]], links[:, 1], links[:, 0])
    sides = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    # A row of triangles round the middle of a ball is no wall: as high as its neighbours.
    high = areas[inner] / np.maximum(areas[outer], 1e-300)
    typical = np.zeros(count)
    for face in np.unique(faces[inner[rim]]):
        at = rim & (faces[inner] == face) & (sides > 0.0)
        typical[face] = np.median(high[at]) if at.any() else 0.0
    return np.asarray(rim & (typical[faces[inner]] >= MIN_LENGTH_RATIO))


def _axes(faces: IntArray, normals: FloatArray, areas: FloatArray) -> FloatArray:
    """Principal directions of each face's normals, (faces, 3, 3), one a row."""
    weighted = normals * areas[:, None]
    columns = [np.bincount(faces, weights=weighted[:, i] * normals[:, j]) for i in range(3) for j in range(3)]
    vectors: FloatArray = np.linalg.eigh(np.stack(columns, axis=1).reshape(-1, 3, 3))[1].transpose(0, 2, 1)
    return vectors


def pieces_of(links: IntArray, ends: FloatArray, normals: FloatArray, areas: FloatArray, corners: FloatArray,
              level: float) -> IntArray | None:  # fmt: skip
    """Pieces of a face whose profile is arcs and straight sides, None where it is no such face or one piece.

    Links between its triangles, (m, 2), with the ends of the sides there, (m, 2, 3); corners (f, 3, 3).
    """
    axis = _axis(normals, areas)
    if axis is None:
        return None
    turn = np.einsum("ij,ij->i", normals[links[:, 0]], normals[links[:, 1]])
    count, facet = connected(links[turn > level], len(normals))
    across = facet[links[:, 0]] != facet[links[:, 1]]
    pairs, middles = np.sort(facet[links[across]], axis=1), ends[across].mean(axis=1)
    order = _chain(np.unique(pairs, axis=0), count)
    if order is None:
        return None
    flat = np.linalg.svd(axis[None])[2][1:]
    profile, closed = _profile(order, pairs, middles @ flat.T, facet, corners @ flat.T)
    widths = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    if not (widths > 0.0).all() or _is_circle(profile):
        return None
    piece = _arcs(profile, widths, closed)
    if piece is None:
        return None
    of_facet = np.zeros(count, dtype=np.int64)
    of_facet[order] = piece
    return of_facet[facet]


def _axis(normals: FloatArray, areas: FloatArray) -> FloatArray | None:
    """The direction with which all normals make one angle."""
    offsets = normals - np.average(normals, axis=0, weights=areas)
    variances, axes = np.linalg.eigh((offsets * areas[:, None]).T @ offsets / areas.sum())
    if variances[0] > STRAIGHT_SIN**2 / 10.0 or variances[1] < STRAIGHT_SIN**2:
        return None
    axis: FloatArray = axes[:, 0]
    return axis


def _chain(pairs: IntArray, count: int) -> IntArray | None:
    """Facets in their order, where each has two neighbours, but for the first and the last one."""
    beside: list[list[int]] = [[] for _ in range(count)]
    for one, two in pairs.tolist():
        beside[one].append(two)
        beside[two].append(one)
    if count < 6 or max(map(len, beside)) > 2 or min(map(len, beside)) < 1:
        return None
    first = next((k for k in range(count) if len(beside[k]) == 1), 0)
    order, last = [first], -1
    while len(order) < count:
        onward = [k for k in beside[order[-1]] if k not in (last, first)]
        if not onward:
            return None
        last = order[-1]
        order.append(onward[0])
    return np.array(order, dtype=np.int64)


def _profile(
    order: IntArray, pairs: IntArray, middles: FloatArray, facet: IntArray, corners: FloatArray
) -> tuple[FloatArray, bool]:
    """Corners of the profile, one more than facets, and whether it is closed; facets between them."""
    low, high = np.sort(np.column_stack([order, np.roll(order, -1)]), axis=1).T
    key = pairs[:, 0] * len(order) + pairs[:, 1]
    found = [middles[key == k].mean(axis=0) if (key == k).any() else None for k in (low * len(order) + high).tolist()]
    last = found.pop()
    if last is not None:
        return np.array([last, *found, last]), True
    begin, end = (
        2.0 * np.unique(corners[facet == order[k]].reshape(-1, 2), axis=0).mean(axis=0) - found[k] for k in (0, -1)
    )
    return np.array([begin, *found, end]), False


def _circle(points: FloatArray) -> tuple[FloatArray, float]:
    middle = points.mean(axis=0)
    q = points - middle
    solved = np.linalg.lstsq(np.column_stack([2.0 * q, np.ones(len(q))]), np.sum(q**2, axis=1), rcond=None)[0]
    return middle + solved[:2], float(np.sqrt(max(solved[2] + solved[:2] @ solved[:2], 0.0)))


def _off(points: FloatArray, widths: FloatArray) -> tuple[float, float]:
    """How far corners leave one circle, and what its sides cut off at most."""
    centre, radius = _circle(points)
    away = np.linalg.norm(points - centre, axis=1) - radius
    return float(np.ptp(away)), float(widths.max()) ** 2 / (8.0 * max(radius, 1e-300))


def _is_circle(profile: FloatArray) -> bool:
    widths = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    off, cut = _off(profile, widths)
    # Straight sides between arcs may be chords of one circle, but are much wider than those of the arcs.
    rounded = SAGITTA_TOLERANCE * cut if widths.max() <= MAX_SIDE_RATIO * float(np.median(widths)) else 0.0
    return off <= max(CIRCLE_TOLERANCE * float(np.linalg.norm(np.ptp(profile, axis=0))), rounded)


def _arcs(profile: FloatArray, widths: FloatArray, closed: bool) -> IntArray | None:
    """Piece of each side of the profile: arcs of three sides or more, single sides, and what is neither."""
    count = len(widths)
    start = int(np.argmax(widths)) if closed else 0
    # A closed profile begins at its longest side, which is of no arc.
    profile = np.concatenate([np.roll(profile[:-1], -start, axis=0), profile[[start]]]) if closed else profile
    widths = np.roll(widths, -start)
    piece, number, known = np.full(count, -1), 0, 0.0
    k = 0
    while k + 3 <= count:
        last = k + 3
        while last <= count and _on_one_circle(profile[k : last + 1], widths[k:last]):
            last += 1
        if last == k + 3:
            k += 1
            continue
        piece[k : last - 1] = number
        known += float(widths[k : last - 1].sum())
        number += 1
        k = last - 1
    changes = np.flatnonzero(np.diff(np.r_[-2, piece, -2]))
    for low, high in itertools.pairwise(changes):
        if piece[low] < 0:
            piece[low:high] = number
            known += float(widths[low]) if high - low == 1 else 0.0
            number += 1
    if number < 2 or known < MIN_KNOWN_SHARE * float(widths.sum()):
        return None
    return np.roll(piece, start)


def _on_one_circle(points: FloatArray, widths: FloatArray) -> bool:
    off, _ = _off(points, widths)
    _, radius = _circle(points)
    return off <= ONE_CIRCLE * float(widths.min()) ** 2 / (8.0 * max(radius, 1e-300))


def connected(links: IntArray, count: int) -> tuple[int, IntArray]:
    """How many parts linked things make, and the part of each."""
    from dqreg.kernels.clouds.components import components

    labels: IntArray = components(count, *np.ascontiguousarray(links.T, dtype=np.int64))
    return int(labels.max(initial=-1)) + 1, labels
