"""Engines: anything that registers, ours or a peer's, behind one protocol.

- `Task`, `EngineOutput`, `Step`, `Engine`: the problem, the answer, an intermediate pose, and who computes them.
- `ENGINES`, `engine`, `available`, `missing`: the engines that come with dqreg, by name.
"""

from __future__ import annotations

from dqreg.compare.engines.protocol import Engine, EngineOutput, Step, Task
from dqreg.compare.engines.registry import ENGINES, available, engine, missing

__all__ = ["ENGINES", "Engine", "EngineOutput", "Step", "Task", "available", "engine", "missing"]
