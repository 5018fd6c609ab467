"""Where to begin when no start is known."""

from __future__ import annotations

from dqreg.start.axes import propose_turns
from dqreg.start.pairs import PairTable, propose
from dqreg.start.search import Candidate, search

__all__ = ["Candidate", "PairTable", "propose", "propose_turns", "search"]
