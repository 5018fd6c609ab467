"""Where to begin when no start is known."""

from __future__ import annotations

from dqreg.start.axes import propose_turns
from dqreg.start.clock import Stage
from dqreg.start.pairs import PairTable
from dqreg.start.search import Candidate, search
from dqreg.start.self_maps import find_symmetry
from dqreg.start.symmetry import Axis, Symmetry

__all__ = ["Axis", "Candidate", "PairTable", "Stage", "Symmetry", "find_symmetry", "propose_turns", "search"]
