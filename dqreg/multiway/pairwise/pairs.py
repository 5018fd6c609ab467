"""Which pairs of scans are worth a registration: all, neighbours, or those that look alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise
from typing import Literal, get_args

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.scans.scans import View, typical_size
from dqreg.search.fpfh import FpfhCloud

# All pairs of that many scans are tried; beyond, those that look alike.
MAX_SCANS_FOR_ALL_PAIRS = 40
Order = Literal["any", "sequence", "turntable"]
ORDERS: tuple[Order, ...] = get_args(Order)
# Pairs are (target, source).
Edges = Literal["auto", "chain", "ring"] | Iterable[Iterable[int]]
EDGE_PLANS = ("auto", "chain", "ring")

# Pairs tried of one scan, and points that describe it.
PAIRS_PER_SCAN, DESCRIBED_POINTS = 8, 5_000
# Kinds of points that are distinguished: visual words.
MAX_WORDS = 128
# Distance of places, in sizes of a scan.
CELL_SIZES = 1.0 / 60.0
# Rounds of the clustering that finds the kinds.
CLUSTERING_ROUNDS = 12

Pair = tuple[int, int]


def asked_pairs(edges: Edges, order: Order, usable: Sequence[int], count: int) -> list[Pair]:
    """Pairs (target, source) to begin with; empty where ``edges="auto"`` leaves many scans to retrieval."""
    if not isinstance(order, str) or order not in ORDERS:
        raise InputError(f"order must be one of {', '.join(ORDERS)}; got {order!r:.60}")
    if isinstance(edges, str):
        if edges not in EDGE_PLANS:
            raise InputError(f"edges must be one of {', '.join(EDGE_PLANS)}, or pairs of scan numbers; got {edges!r}")
        if edges == "auto" and order == "any":
            return list(combinations(usable, 2)) if len(usable) <= MAX_SCANS_FOR_ALL_PAIRS else []
        pairs = list(pairwise(usable))
        closed = edges == "ring" or (edges == "auto" and order == "turntable")
        if closed and len(usable) > 2:
            pairs.append((usable[0], usable[-1]))
        return pairs
    return _given(edges, usable, count)


def _given(edges: Iterable[Iterable[int]], usable: Sequence[int], count: int) -> list[Pair]:
    try:
        pairs = np.array([tuple(pair) for pair in edges])
        whole = pairs.dtype.kind in "iu" and pairs.ndim == 2 and pairs.shape[1] == 2
    except (TypeError, ValueError):
        whole = False
    if not whole:
        raise InputError(
            f"edges must be {', '.join(EDGE_PLANS)}, or pairs of scan numbers (target, source); got {edges!r:.80}"
        )
    for i, j in pairs.tolist():
        if i == j or not (PART < i < count and PART < j < count):
            raise InputError(f"edges hold the pair ({i}, {j}); there are scans 0 to {count - 1}, and a pair needs two")
    found = dict.fromkeys((i, j) for i, j in pairs.tolist() if i in usable and j in usable)
    # A pair and its reverse are one.
    return [(i, j) for i, j in found if (j, i) not in found or i < j]


def alike_pairs(views: Sequence[View], seed: int) -> list[Pair]:
    """Pairs of the scans that share the most kinds of places, by the histograms of their FPFH features.

    A bag of words: features of all scans are clustered, each scan is a histogram of its clusters, rare ones weighed up.
    """
    usable = [k for k, view in enumerate(views) if view.usable]
    size = typical_size(views)
    features = [_features(views[k], size) for k in usable]
    words = _clusters(np.concatenate(features)[:: max(1, len(usable) // 20)], np.random.default_rng(seed))
    counts = np.array([np.bincount(_nearest(each, words), minlength=len(words)) / len(each) for each in features])
    rare = np.log(len(usable) / np.maximum((counts > 0.0).sum(axis=0), 1)) + 0.1
    histograms = np.sqrt(counts) * rare
    histograms /= np.maximum(np.linalg.norm(histograms, axis=1, keepdims=True), np.finfo(float).tiny)
    alike = histograms @ histograms.T
    np.fill_diagonal(alike, -1.0)
    pairs: dict[Pair, None] = {}
    for row in range(len(usable)):
        for other in np.argsort(-alike[row], kind="stable")[:PAIRS_PER_SCAN]:
            pairs[usable[min(row, int(other))], usable[max(row, int(other))]] = None
    return sorted(pairs)


def _features(view: View, size: float) -> FloatArray:
    """Histograms of the places of a scan, for both signs of its normals: which is right, nobody knows."""
    cloud = FpfhCloud.of(view.scan.points, CELL_SIZES * size)
    return np.concatenate([cloud.histograms[:DESCRIBED_POINTS], cloud.opposite_histograms[:DESCRIBED_POINTS]])


def _clusters(features: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Means of the clusters of features, by Lloyd's rounds from drawn ones."""
    means = features[rng.choice(len(features), min(MAX_WORDS, len(features)), replace=False)]
    for _ in range(CLUSTERING_ROUNDS):
        nearest = _nearest(features, means)
        counts = np.bincount(nearest, minlength=len(means))
        sums = np.column_stack([np.bincount(nearest, column, len(means)) for column in features.T])
        means = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], means)
    return means


def _nearest(features: FloatArray, means: FloatArray) -> IntArray:
    distances = (means**2).sum(axis=1) - 2.0 * features @ means.T
    return np.asarray(distances.argmin(axis=1))
