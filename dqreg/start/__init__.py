"""Where to begin when no start is known."""

from __future__ import annotations

from dqreg.start.axes import Candidate, search_axes

__all__ = ["Candidate", "search_axes"]
