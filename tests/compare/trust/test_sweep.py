from __future__ import annotations

import dataclasses
import json

import pytest

from dqreg.cli.main import main
from dqreg.compare.proportions import interval
from dqreg.compare.trust import rates, trust_sweep
from dqreg.compare.trust import sweep as sweep_room
from dqreg.compare.trust.kinds import KINDS
from dqreg.compare.trust.rates import ALL_GOOD, ALL_WRONG, tables
from dqreg.compare.trust.sweep import TrustSweep
from dqreg.compare.trust.trial import Trial
from dqreg.files import code_identity
from dqreg.registration.batch.watch import Failure

NAN = float("nan")


def made(kind: str, seed: int, level: str, *, right: bool, codes: tuple[str, ...] = ()) -> Trial:
    return Trial(kind, seed, KINDS[kind].good, level, right, NAN, codes, "why", 100, 0.5)


@pytest.fixture
def sweep() -> TrustSweep:
    trials = [
        *(made("two-views", seed, "accepted", right=True) for seed in range(3)),
        made("two-views", 3, "suspect", right=True, codes=("stretched", "stretched", "outliers")),
        made("tree", 0, "suspect", right=False, codes=("random_fit",)),
        made("tree", 1, "accepted", right=False),
        made("start-60-180", 0, "accepted", right=True),
        made("start-60-180", 1, "error", right=False),
    ]
    return TrustSweep(tuple(trials), tuple(KINDS[name] for name in ("two-views", "tree", "start-60-180")), (0, 4), ())


def test_rates_count_right_poses_apart_from_wrong_ones(sweep):
    found = {rate.kind: rate for rate in rates(sweep)}
    assert found["two-views"].rate == 0.75
    assert found["two-views"].codes == {"stretched": 1, "outliers": 1}
    assert found["tree"].rate == 0.5
    # The right pose is no wrong accept, and leaves one wrong pose, of which none was accepted.
    assert (found["start-60-180"].rate, found["start-60-180"].errors) == (0.0, 1)
    assert found[ALL_GOOD].rate == 0.75
    assert found[ALL_WRONG].rate == 1 / 3


def test_the_interval_is_that_of_the_binomial_test():
    from scipy.stats import binomtest

    for count, total in ((0, 7), (3, 40), (40, 40)):
        exact = binomtest(count, total).proportion_ci(0.95, method="exact")
        assert interval(count, total) == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_every_wrong_accept_is_listed_with_its_command(sweep):
    wrong = next(table for table in tables(sweep) if table.key == "accepted-wrong")
    assert len(wrong.rows) == 1
    assert "dqreg compare --sweep trust --kinds tree --first-seed 1 --seeds 1" in wrong.rows[0]


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep that was made, and its file."""
    path = tmp_path_factory.mktemp("sweep") / "trust.jsonl"
    return trust_sweep(["noise-box", "few-touched"], seeds=1, workers=1, out=path), path


def test_a_sweep_resumes_and_comes_out_the_same(swept, monkeypatch):
    first, path = swept
    asked = {"seeds": 1, "workers": 1, "out": path}
    assert [(one.kind, one.seed) for one in first.trials] == [("noise-box", 0), ("few-touched", 0)]
    assert not any(one.level == "error" for one in first.trials)

    def never(*_: object, **__: object) -> None:
        raise AssertionError("done before")

    monkeypatch.setattr(sweep_room, "Worker", never)
    again = trust_sweep(["noise-box", "few-touched"], **asked)
    assert json.dumps([dataclasses.asdict(one) for one in again.trials]) == json.dumps(
        [dataclasses.asdict(one) for one in first.trials]
    )


def test_trials_of_other_code_are_made_anew(swept, tmp_path, monkeypatch):
    first, path = swept
    asked = {"seeds": 1, "workers": 1, "out": tmp_path / "trust.jsonl"}
    lines = path.read_text().splitlines(keepends=True)
    # As if that sweep had been of this kind alone.
    asked["out"].write_text("".join(line for line in lines if '"noise-box"' not in line))
    kept = first.trials[1:]
    monkeypatch.setattr(code_identity, "_sources", lambda places: "edited")
    (anew,) = (found := trust_sweep(["few-touched"], **asked)).trials
    assert anew is not kept[0]
    assert len(found.sessions) == 1
    assert len((tmp_path / "trust.jsonl").read_text().splitlines()) == 4


def test_a_task_is_limited_by_its_work_and_not_by_what_else_the_machine_does(monkeypatch):
    class Late:
        closed = False

        def __init__(self, *_: object, **__: object) -> None: ...

        def call(self, task: object, timeout: float, *, cpu: float) -> Failure:
            # Thirty processes on one core leave each of them time enough.
            assert timeout >= 30.0 * cpu
            return Failure("timeout", f"no answer within {cpu:g} s of CPU time")

        def close(self) -> None: ...

    monkeypatch.setattr(sweep_room, "Worker", Late)
    (one,) = trust_sweep(["tree"], seeds=1, workers=1).trials
    assert (one.level, one.reason) == ("error", "no answer within 120 s of CPU time")


def test_an_error_inside_a_task_is_a_trial(monkeypatch):
    monkeypatch.setattr(sweep_room, "trial", lambda *_: 1 / 0)
    assert sweep_room.trial_of("tree", 3).level == "error"
    assert "ZeroDivisionError" in sweep_room.trial_of("tree", 3).reason


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sweep", "trust", "--engine", "dqreg"], "--engine does not go with --sweep trust"),
        (["--sweep", "trust", "part.stl"], "takes no part.stl"),
        (["--sweep", "quick", "--kinds", "tree"], "--kinds goes with --sweep trust"),
        (["--sweep", "trust", "--kinds", "tre"], "did you mean"),
    ],
)
def test_what_does_not_go_together_is_told(arguments, words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["compare", *arguments])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err


def test_kinds_are_listed(capsys):
    with pytest.raises(SystemExit):
        main(["compare", "--sweep", "trust", "--kinds", "list"])
    assert len(capsys.readouterr().out.splitlines()) == len(KINDS) >= 40
