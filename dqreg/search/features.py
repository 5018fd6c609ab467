"""What pairs are made of: places with a direction, the rare ones as likely as the common ones.

Two kinds of places are told apart. On a *face* the direction is the normal. At a *rim*, where a face ends, it is the
direction in the face that leads off it: there a thin plate has its only hold, and a scan of it has no points on the
narrow walls that would tell. On a mesh the rims are its sharp edges, known exactly; on a scan they are the points
whose neighbours all stand on one side.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Mesh, PointCloud, Scan, Surface, sample_mesh
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes, sample_rows

# Points looked at on a scan, and points from which neighbours are taken.
LOOKED_AT, AMONG = 4_000, 20_000
# Neighbours of a fit; of noisy scans; the error of a normal that calls for the larger number.
NEIGHBOURS, MANY_NEIGHBOURS, ROUGH_RAD = 16, 64, 0.08
# A mean of neighbours that far off, in their own spread: half of the neighbourhood is missing (a straight rim has 0.6).
LOPSIDED = 0.42
# Fewer rim points than this say nothing.
FEWEST_RIMS = 20
# Faces that meet at a larger angle meet in a sharp edge.
SHARP_RAD = np.deg2rad(30.0)
# Samples of the sharp edges.
EDGE_SAMPLES = 6_000
# A point whose so-manieth neighbour is so many times farther off than usual is a stray.
LONELY_NEIGHBOURS, LONELY = 8, 3.0
# Plane residuals beyond this share of the size, and this many medians, are of strays and corners.
STRAY, MEDIANS = 4e-3, 5.0


@dataclasses.dataclass(frozen=True)
class Features:
    """Places with directions; face points first, then rim points."""

    # points, directions: (n, 3): Places, and unit normals or directions off the face; either sign
    points: FloatArray
    directions: FloatArray
    is_rim: BoolArray  # (n,): Which kind
    weights: FloatArray  # (n,): How often each shall be drawn, relative; 0 where there is no direction

    def draw(self, count: int, rng: np.random.Generator) -> IntArray:
        """Rows drawn by weight, with replacement."""
        total = np.cumsum(self.weights)
        if not len(total) or total[-1] <= 0.0:
            return np.zeros(0, dtype=np.int64)
        rows: IntArray = np.searchsorted(total, rng.random(count) * total[-1], side="right").astype(np.int64)
        return np.minimum(rows, len(total) - 1)


def scan_features(scan: Scan, size: float) -> Features:
    """Faces and rims of a scan."""
    among = scan.thinned(AMONG)
    cloud = _without_strays(among.points)
    tree = NeighbourTree(cloud)
    points = cloud[sample_rows(len(cloud), LOOKED_AT)]
    fits = fit_planes(tree, cloud, points, NEIGHBOURS)
    if not np.isfinite(fits.variances).any():
        # Three points, or points on threads: no plane anywhere, and nothing that a pair could be told by.
        return Features(points, np.zeros_like(points), np.zeros(len(points), dtype=bool), np.zeros(len(points)))
    if np.nanmedian(np.sqrt(fits.variances)) > ROUGH_RAD:
        fits = fit_planes(tree, cloud, points, MANY_NEIGHBOURS)
    normals, residuals = np.nan_to_num(fits.normals), fits.residuals
    limit = STRAY * size + MEDIANS * float(np.nanmedian(residuals))
    sound = normals.any(axis=1) & ~(residuals > limit)
    faces = np.where(sound, rarity(normals), 0.0)
    at_rim, outwards = rims(tree, cloud, points, normals)
    at_rim &= sound
    if np.count_nonzero(at_rim) < FEWEST_RIMS:
        at_rim[:] = False
    rim_weights = np.full(np.count_nonzero(at_rim), 0.5 * faces.sum() / max(np.count_nonzero(at_rim), 1))
    return Features(
        np.concatenate([points, points[at_rim]]),
        np.concatenate([normals, outwards[at_rim]]),
        np.arange(len(points) + len(rim_weights)) >= len(points),
        np.concatenate([faces, rim_weights]),
    )


def _without_strays(points: FloatArray) -> FloatArray:
    """The points that have neighbours as near as most have."""
    _, distances = NeighbourTree(points).nearest(points, LONELY_NEIGHBOURS)
    near = distances[:, -1] <= LONELY * np.median(distances[:, -1])
    return points[near]


def even_places(target: PointCloud | Mesh, surface: Surface, count: int) -> tuple[FloatArray, FloatArray]:
    """Places evenly over a target, in Morton order, and their normals."""
    points = target.points if isinstance(target, PointCloud) else sample_mesh(target, count, _rng()).points
    points = points[morton_order(points)][sample_rows(len(points), count)]
    return points, surface.closest(points).normals


def target_features(
    target: PointCloud | Mesh, points: FloatArray, normals: FloatArray, count: int
) -> tuple[Features, FloatArray]:
    """Faces and rims of a target."""
    rng = _rng()
    if isinstance(target, Mesh):
        edges, outwards = _sharp_edges(target, rng)
    else:
        at_rim, outwards = rims(NeighbourTree(points), points, points, normals)
        edges, outwards = points[at_rim], outwards[at_rim]
    if len(edges) < FEWEST_RIMS:
        edges, outwards = np.zeros((0, 3)), np.zeros((0, 3))
    rim_rows = rng.choice(len(edges), size=min(len(edges), count // 4), replace=False)
    weights = np.where(normals.any(axis=1), rarity(normals), 0.0)
    rare = np.zeros(0, dtype=np.int64)
    if np.count_nonzero(weights) >= count // 4:
        rare = rng.choice(len(points), size=count // 4, replace=False, p=weights / weights.sum())
    even = sample_rows(len(points), count - count // 4 - len(rim_rows))
    rows = np.union1d(even, rare)
    rows = rows[weights[rows] > 0.0]
    features = Features(
        np.concatenate([points[rows], edges[rim_rows]]),
        np.concatenate([normals[rows], outwards[rim_rows]]),
        np.arange(len(rows) + len(rim_rows)) >= len(rows),
        np.ones(len(rows) + len(rim_rows)),
    )
    return features, edges


def _rng() -> np.random.Generator:
    # The same target gives the same places.
    return np.random.default_rng(0)


def rarity(normals: FloatArray) -> FloatArray:
    """Weights that give every direction, whatever its sign, the root of its share of points."""
    main = np.abs(normals).argmax(axis=1)
    rows = np.arange(len(normals))
    turned = normals * np.where(normals[rows, main] < 0.0, -1.0, 1.0)[:, None]
    others = np.stack([turned[rows, (main + 1) % 3], turned[rows, (main + 2) % 3]], axis=1)
    cells = np.clip((2.5 * (others + 0.8)).astype(np.int64), 0, 3)
    bins = (main * 4 + cells[:, 0]) * 4 + cells[:, 1]
    weights: FloatArray = 1.0 / np.sqrt(np.bincount(bins, minlength=48)[bins])
    return weights


def rims(tree: NeighbourTree, cloud: FloatArray, at: FloatArray, normals: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Where a sampled face ends, and which way leads off it."""
    offsets = cloud[tree.nearest(at, NEIGHBOURS)[0]] - at[:, None, :]
    mean = offsets.mean(axis=1)
    mean -= np.einsum("ij,ij->i", mean, normals)[:, None] * normals
    off = np.linalg.norm(mean, axis=1)
    spread = np.sqrt((offsets**2).sum(axis=2).mean(axis=1))
    outwards = -mean / np.maximum(off, np.finfo(float).tiny)[:, None]
    return (off > LOPSIDED * spread) & normals.any(axis=1), outwards


def _sharp_edges(mesh: Mesh, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Samples along sharp and open edges, and for each the direction off one of its faces."""
    faces, sides = np.divmod(np.arange(3 * len(mesh.faces)), 3)
    beyond = mesh.face_neighbours.reshape(-1)
    cosines = np.einsum("ij,ij->i", mesh.face_normals[faces], mesh.face_normals[beyond])
    # Each sharp edge is met twice, once from either face.
    sharp = np.flatnonzero((cosines < np.cos(SHARP_RAD)) | (beyond == faces))
    if not len(sharp):
        return np.zeros((0, 3)), np.zeros((0, 3))
    start = mesh.corners[faces[sharp], sides[sharp]]
    along = mesh.corners[faces[sharp], (sides[sharp] + 1) % 3] - start
    length = np.linalg.norm(along, axis=1)
    rows = rng.choice(len(sharp), size=EDGE_SAMPLES, p=length / length.sum())
    points = start[rows] + rng.random(len(rows))[:, None] * along[rows]
    outwards = np.cross(along[rows], mesh.face_normals[faces[sharp][rows]]) / length[rows][:, None]
    return points, outwards
