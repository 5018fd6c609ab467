"""Global registration: initial poses without a guess, and the symmetries that make them ambiguous."""

from __future__ import annotations

from dqreg.icp.history import Stage
from dqreg.rigid.symmetry import Axis, Symmetry
from dqreg.search.pairs import PairTable
from dqreg.search.search import Candidate, search
from dqreg.search.symmetry import find_symmetry, symmetry_words

__all__ = ["Axis", "Candidate", "PairTable", "Stage", "Symmetry", "find_symmetry", "search", "symmetry_words"]
