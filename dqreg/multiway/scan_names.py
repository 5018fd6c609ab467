"""Names of scans and pairs, as sentences have them."""

from __future__ import annotations

from collections.abc import Sequence

from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.scans.scans import View

# Scans named in one sentence.
NAMED_SCANS = 8


def name_of(views: Sequence[View], node: int) -> str:
    """Name of a node."""
    return "the part" if node == PART else views[node].name


def pairs_named(views: Sequence[View], pairs: Sequence[tuple[int, int]]) -> str:
    """Names of pairs (target, source) in a sentence."""
    words = ", ".join(f"{name_of(views, target)} - {name_of(views, source)}" for target, source in pairs[:NAMED_SCANS])
    return words if len(pairs) <= NAMED_SCANS else f"{words} and {len(pairs) - NAMED_SCANS} more"


def named(views: Sequence[View], scans: Sequence[int]) -> str:
    """Names of scans in a sentence."""
    if len(scans) == len(views) > NAMED_SCANS:
        return f"all {len(views)} scans"
    words = ", ".join(views[k].name for k in scans[:NAMED_SCANS])
    return words if len(scans) <= NAMED_SCANS else f"{words} and {len(scans) - NAMED_SCANS} more"
