"""The studio: a local page for a scan and its part, from two files to a signed sheet."""

from __future__ import annotations

from dqreg.studio.replay import replay
from dqreg.studio.visit import Visit

__all__ = ["Visit", "replay"]
