"""Engines: anything that registers, ours or a peer's, behind one protocol.

- `Task`, `Attempt`, `Step`, `Engine`: what is to be done, what came out, and who does it. - `ENGINES`, `engine`,
`available`, `missing`: those that come with dqreg, by name. - `FunctionEngine`: a function of one's own as an engine;
any object that satisfies the protocol is as good.
"""

from __future__ import annotations

from dqreg.compare.engines.custom import FunctionEngine
from dqreg.compare.engines.protocol import Attempt, Engine, Step, Task
from dqreg.compare.engines.registry import ENGINES, available, engine, missing

__all__ = ["ENGINES", "Attempt", "Engine", "FunctionEngine", "Step", "Task", "available", "engine", "missing"]
