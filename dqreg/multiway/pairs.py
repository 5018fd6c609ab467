"""Which pairs of scans are worth a registration."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.multiway.edges import PART

# All pairs of that many scans are tried; beyond, those that look alike.
ALL_PAIRS = 40
EDGES = ("auto", "chain", "ring")
ORDERS = ("any", "sequence", "turntable")

Pair = tuple[int, int]


def asked_pairs(edges: Any, order: str, usable: Sequence[int], count: int) -> list[Pair]:
    """Pairs (target, source) to begin with; empty where ``edges="auto"`` leaves many scans to retrieval."""
    if not isinstance(order, str) or order not in ORDERS:
        raise InputError(f"order must be one of {', '.join(ORDERS)}; got {order!r:.60}")
    if isinstance(edges, str):
        if edges not in EDGES:
            raise InputError(f"edges must be one of {', '.join(EDGES)}, or pairs of scan numbers; got {edges!r}")
        if edges == "auto" and order == "any":
            return list(combinations(usable, 2)) if len(usable) <= ALL_PAIRS else []
        pairs = list(pairwise(usable))
        closed = edges == "ring" or (edges == "auto" and order == "turntable")
        if closed and len(usable) > 2:
            pairs.append((usable[0], usable[-1]))
        return pairs
    return _given(edges, usable, count)


def _given(edges: Any, usable: Sequence[int], count: int) -> list[Pair]:
    try:
        pairs = np.array([tuple(pair) for pair in edges])
        whole = pairs.dtype.kind in "iu" and pairs.ndim == 2 and pairs.shape[1] == 2
    except (TypeError, ValueError):
        whole = False
    if not whole:
        raise InputError(
            f"edges must be {', '.join(EDGES)}, or pairs of scan numbers (target, source); got {edges!r:.80}"
        )
    for i, j in pairs.tolist():
        if i == j or not (PART < i < count and PART < j < count):
            raise InputError(f"edges hold the pair ({i}, {j}); there are scans 0 to {count - 1}, and a pair needs two")
    found = dict.fromkeys((i, j) for i, j in pairs.tolist() if i in usable and j in usable)
    # A pair and its reverse are one.
    return [(i, j) for i, j in found if (j, i) not in found or i < j]
