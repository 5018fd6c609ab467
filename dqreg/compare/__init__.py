"""The same tasks through every engine, ours and our peers', scored by one judge.

- `dqreg.compare.judge`: pose errors and surface errors; imports no engine.
- `dqreg.compare.plan`, `dqreg.compare.case`, `dqreg.compare.sweep`: the cases, in two settings.
- `dqreg.compare.run`: the comparison; `dqreg.compare.run_engine`: each engine in a process of its own;
  `dqreg.compare.store`: every run as a JSON line.
- `dqreg.compare.summary`, `dqreg.compare.tables`, `dqreg.compare.plots`, `dqreg.compare.output`: the results.
"""

from __future__ import annotations

from dqreg.compare.case import BenchmarkCase, SameLoop
from dqreg.compare.judge import GroundTruth, Score, judge
from dqreg.compare.plan import Protocol, from_case, from_pair
from dqreg.compare.run import Comparison, ComparisonProgress, compare
from dqreg.compare.sweep import Sweep
from dqreg.compare.sweep_file import read_sweep
from dqreg.compare.truth import TruePoses, read_truth
from dqreg.files.poses import read_pose

__all__ = [
    "BenchmarkCase",
    "Comparison",
    "ComparisonProgress",
    "GroundTruth",
    "Protocol",
    "SameLoop",
    "Score",
    "Sweep",
    "TruePoses",
    "compare",
    "from_case",
    "from_pair",
    "judge",
    "read_pose",
    "read_sweep",
    "read_truth",
]
