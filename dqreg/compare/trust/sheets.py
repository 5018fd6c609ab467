"""Folded sheets: without normals a scan of one side may come to lie on the other one, a thickness off."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.compare.trust import scans
from dqreg.compare.trust.task import Kind, Make, TrustTask, Walls, kinds_of, on_part
from dqreg.geometry import Mesh, sample_mesh

# Turns of the profile at its folds: an angle, a channel, a Z and a hat.
PROFILE_TURNS = ((1.0,), (1.0, 1.0), (1.0, -1.0), (1.0, -1.0, -1.0, 1.0))
FOLDS_DEG = (60.0, 90.0)
THICKNESS_SIZES, NOISE_THICKNESSES = (0.003, 0.02), (0.05, 0.2)
# Points of a whole sheet, and the share of a side that is scanned.
SHEET_POINTS, COVERED_SHARE = (6_000, 40_000), (0.4, 1.0)
# How probably each of its four rims is scanned.
RIM_PROBABILITY = 0.3


@dataclasses.dataclass(frozen=True, eq=False)
class Sheet:
    """A folded sheet."""

    mesh: Mesh
    across: FloatArray  # (legs, 3): Normals of its legs, outwards on one side
    thickness: float


def folded(rng: np.random.Generator) -> Sheet:
    """A sheet folded once, twice or four times about parallel axes."""
    fold = FOLDS_DEG[1] if rng.uniform() < 0.5 else rng.uniform(*FOLDS_DEG)
    turns = np.array(PROFILE_TURNS[rng.integers(len(PROFILE_TURNS))]) * np.deg2rad(fold)
    angles = np.concatenate([[0.0], np.cumsum(turns)])
    legs = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(legs * rng.uniform(25, 100, (len(legs), 1)), axis=0)])
    width = rng.uniform(30, 120)
    thickness = float(rng.uniform(*THICKNESS_SIZES) * np.linalg.norm([*np.ptp(line, axis=0), width]))
    aside = np.stack([-legs[:, 1], legs[:, 0]], axis=1)
    # At a fold both sides are mitred.
    before, after = np.concatenate([aside[:1], aside]), np.concatenate([aside, aside[-1:]])
    mitred = (before + after) / (1.0 + np.einsum("ij,ij->i", before, after))[:, None]
    ring = np.concatenate([line + 0.5 * thickness * mitred, (line - 0.5 * thickness * mitred)[::-1]])
    count = len(ring)
    vertices = np.concatenate([np.insert(ring, 1, y, axis=1) for y in (0.0, width)])
    here, there = np.arange(count), np.roll(np.arange(count), -1)
    k = np.arange(len(line) - 1)
    ends = np.concatenate([np.stack([k, k + 1, count - 2 - k], 1), np.stack([k, count - 2 - k, count - 1 - k], 1)])
    around = [np.stack([here, here + count, there], 1), np.stack([there, here + count, there + count], 1)]
    mesh = Mesh(vertices, np.concatenate([ends, ends[:, ::-1] + count, *around])[:, ::-1])
    return Sheet(mesh, np.insert(aside, 1, 0.0, axis=1), thickness)


def scanned(*, both: bool) -> Make:
    """Part of one side of a sheet, or of both, with some of its rims; from nothing, or from a thickness off."""

    def make(rng: np.random.Generator) -> TrustTask:
        sheet = folded(rng)
        mesh, thickness = sheet.mesh, sheet.thickness
        found = sample_mesh(mesh, int(rng.integers(*SHEET_POINTS)), rng)
        assert found.normals is not None
        facing = found.normals @ sheet.across.T
        leg = _legs(mesh, sheet, found.points)
        side = facing[np.arange(len(leg)), leg]
        is_rim = np.abs(side) < 0.5
        wanted = np.ones(len(leg), dtype=bool) if both else side * rng.choice([-1.0, 1.0]) > 0.5
        seen = np.where(is_rim, _rims(mesh, found.points, rng), wanted)
        away = np.linalg.norm(found.points - found.points[rng.integers(len(leg))], axis=1)
        seen &= away <= np.quantile(away, rng.uniform(*COVERED_SHARE))
        noise = thickness * rng.uniform(*NOISE_THICKNESSES)
        scan = found.points[seen] + noise * rng.normal(size=(np.count_nonzero(seen), 3))
        size = mesh.diagonal
        start = None if rng.uniform() < 0.5 else (3.0, thickness / size)
        walls = Walls(found.points[~is_rim], found.normals[~is_rim], thickness)
        return on_part(scans.thinned(scan, rng, 1_500, 20_000), mesh, rng, noise=noise / size, start=start, walls=walls)

    return make


def _rims(mesh: Mesh, points: FloatArray, rng: np.random.Generator) -> BoolArray:
    """Which points on rims, (n, 3), are of those that are seen, (n,): two cuts, and first and last edge."""
    width, count = mesh.bounds[1][1], len(mesh.vertices) // 2
    first, last = (mesh.vertices[[k, count - 1 - k]].mean(axis=0) for k in (0, count // 2 - 1))
    is_cut = np.minimum(points[:, 1], width - points[:, 1]) < 1e-9 * mesh.diagonal
    near = [np.linalg.norm((points - end) * [1.0, 0.0, 1.0], axis=1) for end in (first, last)]
    rim = np.where(is_cut, points[:, 1] > 0.5 * width, 2 + (near[1] < near[0]))
    return np.asarray((rng.uniform(size=4) < RIM_PROBABILITY)[rim.astype(np.int64)])


def _legs(mesh: Mesh, sheet: Sheet, points: FloatArray) -> FloatArray:
    """Which leg each point, (n, 3), is of, (n,)."""
    count, legs = len(mesh.vertices) // 2, len(sheet.across)
    k = np.arange(legs + 1)
    middles = 0.5 * (mesh.vertices[k] + mesh.vertices[count - 1 - k])
    along = np.diff(middles, axis=0)
    away = np.stack([np.linalg.norm(_aside(points - a, d), axis=1) for a, d in zip(middles[:-1], along, strict=True)])
    return np.asarray(away.argmin(axis=0))


def _aside(offsets: FloatArray, along: FloatArray) -> FloatArray:
    """Offsets, (n, 3), from the nearest place of a leg in the plane of the profile."""
    flat = offsets * [1.0, 0.0, 1.0]
    share = np.clip(flat @ along / (along @ along), 0.0, 1.0)
    return np.asarray(flat - share[:, None] * along)


KINDS: tuple[Kind, ...] = kinds_of(
    "sheets",
    False,
    ("sheet-one-side", "folded sheet, one side of it", scanned(both=False)),
    ("sheet-both-sides", "folded sheet, part of both sides", scanned(both=True)),
)
