from __future__ import annotations

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest

import dqreg
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.trial import trial
from dqreg.synth.parts import bracket
from dqreg.trust import confidence as room
from dqreg.trust.confidence import NAMES, figures_of, probability
from dqreg.trust.records import Reason, Verdict


def test_a_right_pose_is_more_probable_than_noise_and_both_survive_the_file(tmp_path):
    part = dqreg.Mesh(*bracket())
    rng = np.random.default_rng(0)
    points = dqreg.geometry.sample_mesh(part, 1500, rng).points + 0.02 * rng.normal(size=(1500, 3))
    good = dqreg.register(points, part, "identity", search="never")
    bad = dqreg.register(rng.normal(size=(200, 3)) * 20 + part.centre, part, "identity", search="never")
    assert good.verdict.level == "accepted"
    assert good.verdict.confidence > 0.9
    assert bad.verdict.confidence < 0.2
    good.save(tmp_path / "r.json")
    assert dqreg.Registration.load(tmp_path / "r.json").verdict.confidence == good.verdict.confidence
    assert good.to_dict()["verdict"]["confidence"] == good.verdict.confidence


def test_no_pose_and_a_later_doubt_have_no_confidence():
    verdict = Verdict("accepted", (Reason("fits", "accepted"),), confidence=0.97)
    assert math.isnan(verdict.doubted(Reason("late", "time_stamp")).confidence)
    assert math.isnan(Verdict("failed", ("no pose",)).confidence)
    assert verdict == dataclasses.replace(verdict, confidence=math.nan), "a probability is no part of what is decided"


def test_no_motion_that_is_left_is_no_uncertain_one():
    mesh = dqreg.Mesh(*bracket())
    part, rng = dqreg.prepare_target(mesh), np.random.default_rng(0)
    points = dqreg.geometry.sample_mesh(mesh, 1500, rng).points + 0.02 * rng.normal(size=(1500, 3))
    locked = part.register(points, "identity", dof="none", search="never")
    free = part.register(points, "identity", search="never")
    # Locked at the truth, a pose is as sure as can be; with one that is off by 1 % of the size, it is still refused.
    assert locked.verdict.level == "accepted"
    assert locked.verdict.confidence >= free.verdict.confidence
    off = part.register(points, dqreg.rigid.pose.exp([0, 0, 0, 1.5, 0, 0]), dof="none", search="never")
    assert off.verdict.level == "suspect"


def test_the_names_of_the_weights_are_those_of_the_figures():
    part = dqreg.Mesh(*bracket())
    figures = dqreg.register(part, part, "identity", effort="fast", search="never").verdict._figures
    assert tuple(figures) == NAMES == tuple(room.WEIGHTS)
    assert np.isfinite(list(figures.values())).all()


@pytest.mark.parametrize("seed", [20000, 20002, 20005])
def test_the_confidence_is_that_of_the_figures_beside_it(seed):
    # Of a scan that is longer than the part, poses are compared after the answer, whose verdict is known by then.
    done = trial(KINDS["longer-5-20"], seed)
    assert probability(dict(zip(NAMES, done.figures, strict=True))) == done.confidence


def test_a_verdict_and_its_copies_carry_the_figures_of_its_confidence():
    task = KINDS["longer-5-20"].task(20002)
    verdict = dqreg.register(task.source, task.target, task.start, **task.options).verdict
    for one in (verdict, copy.copy(verdict), pickle.loads(pickle.dumps(verdict))):
        assert probability(one._figures) == verdict.confidence
    # Without a confidence there are none: after a later doubt, and where no pose was found.
    assert not verdict.doubted(Reason("late", "time_stamp"))._figures
    assert math.isnan(probability({}))


def test_probability_is_logistic(monkeypatch):
    monkeypatch.setattr(room, "OFFSET", 1.0)
    monkeypatch.setattr(room, "WEIGHTS", {"inliers": 2.0})
    assert probability({"inliers": 0.5}) == 1.0 / (1.0 + math.exp(-2.0))
    assert probability({"inliers": -1e9}) < 1e-12
    assert figures_of.__doc__
