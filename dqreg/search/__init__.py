"""Where to begin when no start is known."""

from __future__ import annotations

from dqreg.search.axes import propose_turns
from dqreg.search.pairs import PairTable
from dqreg.search.poses import Stage
from dqreg.search.search import Candidate, search
from dqreg.search.self_maps import find_symmetry
from dqreg.search.symmetry import Axis, Symmetry

__all__ = ["Axis", "Candidate", "PairTable", "Stage", "Symmetry", "find_symmetry", "propose_turns", "search"]
