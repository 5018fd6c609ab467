"""Small engines whose answers are known: an honest one, and every kind of trouble."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from dqreg.compare.engines.protocol import EngineOutput, Step
from dqreg.synth import demo_case, load_case

TRUTH = load_case(demo_case()).T_target_source


class ToyEngine:
    needs = ()
    needs_initial_pose = False
    settings = ("manual", "same-loop")

    def __init__(self, name, answer):
        self.name, self.answer = name, answer

    def register(self, task):
        T = self.answer(task)
        start = np.eye(4) if task.start is None else task.start
        steps = (Step(1, 0.001, start), Step(2, float("nan"), T))
        settings = {"points": len(task.source)}
        return EngineOutput(T, "converged", 2, steps, 0.002, 0.001, settings)


def _wrong(task):
    T = TRUTH.copy()
    T[:3, 3] += 20.0
    return T


def _hang(task):
    time.sleep(600)


def _crash(task):
    os.write(2, b"out of cheese\n")
    os.abort()


def _raise(task):
    raise RuntimeError("no <b>luck</b> today")


def _greedy(task):
    hoard = []
    while True:
        hoard.append(np.ones(2_000_000))
        time.sleep(0.005)


def _counts(task):
    with Path(os.environ["DQREG_TEST_COUNT"]).open("a") as stream:
        stream.write(f"{len(task.source)} {task.setting} {os.environ.get('OMP_NUM_THREADS')}\n")
    return TRUTH


perfect = ToyEngine("perfect", lambda task: TRUTH)
wrong = ToyEngine("wrong", _wrong)
identity = ToyEngine("identity", lambda task: np.eye(4))
mirrored = ToyEngine("mirrored", lambda task: TRUTH @ np.diag([1.0, 1.0, -1.0, 1.0]))
nothing = ToyEngine("nothing", lambda task: np.full((4, 4), np.nan))
raising = ToyEngine("raising", _raise)
hanging = ToyEngine("hanging", _hang)
crashing = ToyEngine("crashing", _crash)
greedy = ToyEngine("greedy", _greedy)
counting = ToyEngine("counting", _counts)
