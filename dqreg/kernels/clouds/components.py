"""Connected components of a graph, by union and find."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import IntArray
from dqreg.kernels.compiling.compiled import compiled, inside_kernels


@compiled
def components(count: int, one: IntArray, two: IntArray) -> IntArray:
    """Component of each of so many nodes that links join, (n,), numbered by its first node.

    Shapes: one, two (m,), the nodes of each link. Nearly O(n + m).
    """
    parents, labels = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for i in range(count):
        parents[i] = i
    for k in range(len(one)):
        unite(parents, one[k], two[k])
    found = 0
    for i in range(count):
        # A parent comes before its children, so that its number is known.
        if parents[i] == i:
            labels[i] = found
            found += 1
        else:
            labels[i] = labels[parents[i]]
    return labels


@inside_kernels
def unite(parents: IntArray, a: int, b: int) -> None:
    """Put two nodes into one component, whose root is the lower of both roots."""
    # Each step to a root halves the way for the next.
    while parents[a] != a:
        parents[a] = parents[parents[a]]
        a = parents[a]
    while parents[b] != b:
        parents[b] = parents[parents[b]]
        b = parents[b]
    parents[max(a, b)] = min(a, b)
