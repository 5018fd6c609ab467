"""Engines: anything that registers, ours or a peer's, behind one protocol."""

from __future__ import annotations

from dqreg.engines.protocol import Attempt, Engine, Step, Task

__all__ = ["Attempt", "Engine", "Step", "Task"]
