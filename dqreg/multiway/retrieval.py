"""Scans that look alike, where there are too many to try all pairs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.pairs import Pair
from dqreg.multiway.scans import View, typical_size
from dqreg.search.fpfh import FpfhCloud

# Pairs tried of one scan, points that describe it, and kinds of places that are told apart.
ALIKE, POINTS, WORDS = 8, 5_000, 128
# Distance of places, in sizes of a scan.
CELL = 1.0 / 60.0
# Rounds of the clustering that finds the kinds.
ROUNDS = 12


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
        for other in np.argsort(-alike[row], kind="stable")[:ALIKE]:
            pairs[usable[min(row, int(other))], usable[max(row, int(other))]] = None
    return sorted(pairs)


def _features(view: View, size: float) -> FloatArray:
    """Histograms of the places of a scan, for both signs of its normals: which is right, nobody knows."""
    cloud = FpfhCloud.of(view.scan.points, CELL * size)
    return np.concatenate([cloud.histograms[:POINTS], cloud.opposite_histograms[:POINTS]])


def _clusters(features: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Means of the clusters of features, by Lloyd's rounds from drawn ones."""
    means = features[rng.choice(len(features), min(WORDS, len(features)), replace=False)]
    for _ in range(ROUNDS):
        nearest = _nearest(features, means)
        counts = np.bincount(nearest, minlength=len(means))
        sums = np.column_stack([np.bincount(nearest, column, len(means)) for column in features.T])
        means = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], means)
    return means


def _nearest(features: FloatArray, means: FloatArray) -> IntArray:
    distances = (means**2).sum(axis=1) - 2.0 * features @ means.T
    return np.asarray(distances.argmin(axis=1))
