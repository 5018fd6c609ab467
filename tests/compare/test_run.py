from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dqreg.compare import Protocol, SameLoop, compare, from_case, from_pair, read_sweep, run_engine
from dqreg.compare.case import make_case, small_copy
from dqreg.compare.engines.registry import engine_specs
from dqreg.compare.plan import plan
from dqreg.compare.run import ComparisonProgress
from dqreg.compare.store import Store
from dqreg.compare.sweep_file import parse_sweep
from dqreg.compare.truth import TruePoses
from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.synth import demo_case, load_case

FILE = Path(__file__).with_name("toy_engines.py")
CASE = load_case(demo_case())
TRUTH = CASE.T_target_source
SMALL = SameLoop(source_points=500, target_points=2_000)
ONCE = Protocol(settings=("manual",), repeats=1, isolate=False)


@pytest.fixture(scope="module")
def task():
    return from_case(CASE)


@pytest.fixture(scope="module")
def both(task):
    return [task, from_case(CASE, setting="same-loop", loop=SMALL)]


def some(*names: str) -> list:
    # The engines of the file, loaded by path as a worker would.
    return [spec.load() for spec in engine_specs([FILE]) if spec.name in names]


class Still:
    """Holds a pose; picklable only as long as this module can be imported by name, which pytest does not promise."""

    def __init__(self, name: str, T: np.ndarray) -> None:
        self.name, self.T = name, T

    def register(self, task):
        return self.T


def test_judged_in_process(task):
    names = ("perfect", "wrong", "identity", "mirrored", "nothing", "raising")
    found = compare(task, some(*names), protocol=ONCE)
    by = {run.engine: run for run in found.runs}
    assert [name for name in names if by[name].success] == ["perfect"]
    assert by["mirrored"].kind == "mirrored"
    assert by["nothing"].status == "ran"
    assert np.isnan(by["nothing"].worst)
    assert (by["raising"].status, by["raising"].message) == ("error", "RuntimeError: no <b>luck</b> today")
    # The engine's own clock: it may leave out what is not registration, but never add.
    assert by["perfect"].seconds == min(0.002, by["perfect"].wall_seconds)
    assert by["perfect"].curve[-1][2] == 0.0
    assert by["perfect"].overlap > 0.9


def test_engines_get_the_same_and_never_the_held_out_points(both):
    seen = []

    class Spy:
        name = "spy"
        settings = ("manual", "same-loop")

        def register(self, task):
            seen.append(task)
            return np.eye(4)

    compare(both, [Spy()], protocol=Protocol(repeats=2, isolate=False))
    full = [task for task in seen if len(task.source) > 10_000]
    assert len(full) == 6  # two settings, two repeats, and one run more for the curve
    loops = [task for task in full if task.setting == "same-loop"]
    assert all(len(task.source_points) == 500 and len(task.target_points) == 2_000 for task in loops)
    assert all(np.array_equal(task.source_points, loops[0].source_points) for task in loops)
    assert loops[0].max_distance == pytest.approx(0.1 * CASE.part_diagonal)
    held = both[0].ground_truth.held_out
    given = {row.tobytes() for row in full[0].source.points}
    assert len(held) == 5_000
    assert not any(row.tobytes() in given for row in held)


def test_crash_hang_and_memory_cost_one_row_each(task, monkeypatch):
    monkeypatch.setattr(run_engine, "WARM_SECONDS", 0.0)
    found = compare(
        task,
        [FILE],
        protocol=Protocol(repeats=2, timeout=1.5, threads=1, memory_limit=700e6),
    )
    by = {}
    for run in found.runs:
        by.setdefault(run.engine, []).append(run)
    assert [run.status for run in by["perfect"]] == ["ran", "ran"]
    assert all(run.success for run in by["perfect"])
    assert [run.status for run in by["hanging"]] == ["timeout"]
    assert [run.status for run in by["crashing"]] == ["crashed"]
    assert "out of cheese" in by["crashing"][0].message
    assert by["greedy"][0].status in ("memory", "timeout")
    # The one after a crash runs as if nothing had been; its environment holds the number of threads.
    assert by["counting"][0].status == "error"  # DQREG_TEST_COUNT is not set
    assert not any(run.success for name, runs in by.items() for run in runs if name != "perfect")


def test_resume_repeats_nothing_and_loses_nothing(both, tmp_path, monkeypatch):
    monkeypatch.setenv("DQREG_TEST_COUNT", str(tmp_path / "count"))
    out, protocol = tmp_path / "runs.jsonl", Protocol(repeats=2, isolate=False)

    class StopHereError(Exception):
        pass

    def stop_after_three(progress: ComparisonProgress) -> None:
        if progress.run is not None and len(Store(out).runs) == 3:
            raise StopHereError

    with pytest.raises(StopHereError):
        compare(both, some("counting"), protocol=protocol, out=out, observe=stop_after_three)
    before = out.read_bytes()
    assert len(Store(out).runs) == 3
    found = compare(both, some("counting"), protocol=protocol, out=out)
    assert out.read_bytes().startswith(before)
    assert [(run.setting, run.repeat) for run in found.runs] == [
        ("manual", 0), ("manual", 1), ("same-loop", 0), ("same-loop", 1),
    ]  # fmt: skip
    assert len(found.sessions) == 2
    count = (tmp_path / "count").read_text()
    again = compare(both, some("counting"), protocol=protocol, out=out)
    assert (tmp_path / "count").read_text() == count
    assert len(again.runs) == 4
    # One more repeat: one more run of each task, not three.
    more = compare(both, some("counting"), protocol=Protocol(repeats=3, isolate=False), out=out)
    assert len(more.runs) == 6


def test_kept_runs_are_judged_by_todays_rules(task, tmp_path):
    strict, lax = (Protocol(repeats=1, isolate=False, success_threshold=home) for home in (0.01, 0.3))
    first = compare(task, some("wrong"), protocol=strict, out=tmp_path / "runs.jsonl")
    again = compare(task, some("wrong"), protocol=lax, out=tmp_path / "runs.jsonl")
    # The wrong pose is shifted by 20 mm along each axis: 0.22 of the part's 156 mm.
    assert [run.success for run in (*first.runs, *again.runs)] == [False, True]


def test_a_killed_comparison_goes_on(tmp_path):
    out, engines = tmp_path / "runs.jsonl", tmp_path / "engines.py"
    engines.write_text(
        "import os, time\nimport numpy as np\nclass Still:\n"
        "    def __init__(self, name):\n        self.name = name\n"
        "    def register(self, task):\n"
        "        time.sleep(600.0 if os.environ.get('DQREG_TEST_HANG') == self.name else 0.0)\n"
        "        return np.eye(4)\n"
        "first, second = Still('first'), Still('second')\n"
    )
    code = (
        "import sys\nfrom dqreg.compare import *\nfrom dqreg.synth import demo_case\n"
        "compare(demo_case(), [sys.argv[1]],\n"
        "        protocol=Protocol(settings=('manual',), repeats=1, isolate=False), out=sys.argv[2])\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "DQREG_TEST_HANG": "second"}
    process = subprocess.Popen([sys.executable, "-c", code, str(engines), str(out)], env=environment)
    try:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and not (out.exists() and len(out.read_bytes().splitlines()) >= 2):
            time.sleep(0.05)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert [run.engine for run in Store(out).runs] == ["first"]
    found = compare(CASE, [engines], protocol=ONCE, out=out)
    assert sorted(run.engine for run in found.runs) == ["first", "second"]
    assert len(Store(out).runs) == 2


def test_torn_last_line_is_cut_off(task, tmp_path):
    out = tmp_path / "runs.jsonl"
    engines = [Still("perfect", TRUTH), Still("wrong", np.eye(4))]
    compare(task, engines, protocol=ONCE, out=out)
    whole = out.read_bytes()
    out.write_bytes(whole[:-40])
    store = Store(out)
    assert [run.engine for run in store.runs] == ["perfect"]
    compare(task, engines, protocol=ONCE, out=out)
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    assert [line.get("engine") for line in lines] == [None, "perfect", None, "wrong"]


def test_files_with_the_keys_of_version_0_1_still_load(task, tmp_path):
    out = tmp_path / "runs.jsonl"
    kept = compare(task, some("perfect"), protocol=ONCE, out=out).runs
    old = {b'"without_initial_pose"': b'"from_nothing"', b'"self_report"': b'"claims"'}
    content = out.read_bytes()
    for new, key in old.items():
        assert content.count(new) == 1
        content = content.replace(new, key)
    out.write_bytes(content)
    assert repr(Store(out).runs) == repr(list(kept))  # Some figures are NaN


@pytest.mark.parametrize("content", [b"hello", b'{"a": 1}\n', b'{"format": "dqreg comparison 1"}\nxx\n'])
def test_other_files_are_left_alone(task, tmp_path, content):
    out = tmp_path / "notes.txt"
    out.write_bytes(content)
    with pytest.raises(InputError, match="notes"):
        compare(task, some("perfect"), protocol=ONCE, out=out)
    assert out.read_bytes() == content


def test_another_case_of_the_same_name_is_another_task(both):
    here = both[0]
    there = from_case(CASE, seed=1)
    assert here.key != there.key
    assert from_case(CASE).key == here.key
    assert both[1].key != here.key
    assert from_case(CASE, withhold_initial_pose=True).key != here.key


def test_engine_that_needs_an_initial_pose_takes_no_part_without(tmp_path):
    still = Still("still", np.eye(4))
    found = compare(
        CASE, [still, *some("perfect")], protocol=Protocol(repeats=1, isolate=False, withhold_initial_pose=True)
    )
    assert [(run.engine, run.setting, run.without_initial_pose) for run in found.runs] == [("perfect", "manual", True)]


def test_engines_that_fit_no_task_are_named():
    blind = Protocol(repeats=1, isolate=False, withhold_initial_pose=True)
    found = compare(CASE, [Still("still", np.eye(4)), *some("perfect")], protocol=blind)
    assert found.unfit == {"still": "needs an initial pose"}
    assert found.starts == ()
    with pytest.raises(InputError, match="no engine fits: still needs an initial pose"):
        compare(CASE, [Still("still", np.eye(4))], protocol=blind)


def test_the_initial_pose_is_judged_as_if_an_engine_had_returned_it(both):
    found = compare(both, some("perfect"), protocol=ONCE)
    assert [(run.engine, run.setting, run.success) for run in found.starts] == [
        ("initial pose", "manual", False), ("initial pose", "same-loop", False),
    ]  # fmt: skip
    assert np.degrees(found.starts[0].angle_rad) == pytest.approx(20.0, abs=1e-6)
    wide = compare(both, some("perfect"), protocol=dataclasses.replace(ONCE, success_threshold=0.9))
    assert [run.success for run in wide.starts] == [True, True]


def test_a_truth_that_is_given_inverted_is_said():
    right, odd = Still("right", TRUTH), Still("right too", TRUTH)
    turned = from_pair(CASE.scan, CASE.part, truth=TruePoses(np.linalg.inv(TRUTH)[None]), start="identity")
    (hint,) = compare(turned, [right, odd, Still("lost", np.eye(4))], protocol=ONCE).hints
    assert "the inverse of the true one" in hint
    # One engine may err by itself.
    assert compare(turned, [right], protocol=ONCE).hints == ()
    assert compare(CASE, [right, odd], protocol=ONCE).hints == ()


def test_different_cases_of_one_name_are_numbered(tmp_path):
    cases = [from_pair(CASE.scan, CASE.part, T, TruePoses(CASE.T_target_source[None])) for T in (np.eye(4), TRUTH)]
    engines = [Still("identity", np.eye(4))]
    found = compare([*cases, cases[0]], engines, protocol=ONCE, out=tmp_path / "runs.jsonl")
    names = [f"{CASE.scan.name} on {CASE.part.name} ({number})" for number in (1, 2)]
    assert [run.case for run in found.runs] == [run.case for run in found.starts] == names
    assert found.title == ", ".join(names)
    # The order of the tasks counts, not that of the file.
    again = compare(cases[::-1], engines, protocol=ONCE, out=tmp_path / "runs.jsonl")
    assert [(run.case, run.key) for run in again.runs] == [
        (names[1], cases[0].key), (names[0], cases[1].key),
    ]  # fmt: skip


def test_larger_scans_are_not_tried_after_one_ran_out_of_time(tmp_path, monkeypatch):
    monkeypatch.setattr(run_engine, "WARM_SECONDS", 0.0)
    sweep = parse_sweep("timeout = 1.0\n[axis.points]\nvalues = [500, 1000, 2000]", "sizes")
    path = tmp_path / "one.py"
    path.write_text("import time\nclass Slow:\n  name='slow'\n  def register(self, task): time.sleep(30)\nslow=Slow()")
    found = compare(sweep, [path], protocol=Protocol(timeout=1.0, threads=1))
    assert [(run.value, run.status) for run in found.runs] == [(500, "timeout")]


def test_engines_of_one_axis_stay_there_unless_the_caller_names_them():
    text = "engines = ['a']\n[axis.noise]\nvalues = [0.0]\n[axis.outliers]\nvalues = [0.0]\nmore_engines = ['b']"
    sweep = parse_sweep(text, "two")
    assert sweep.all_engines == ("a", "b")
    a, b = (Still(name, np.eye(4)) for name in "ab")
    items, _ = plan(sweep, ONCE)
    taken = [[name for name in "ab" if item.takes(engine_specs([{"a": a, "b": b}[name]])[0])] for item in items]
    assert taken == [["a"], ["a", "b"]]
    small = parse_sweep("[base]\npoints = 200\n" + text.partition("\n")[2], "two")
    assert len(compare(small, [a, b], protocol=ONCE).runs) == 4


@pytest.mark.parametrize(
    ("engines", "said"),
    [
        ([], "at least one"),
        ([object()], "not an engine"),
        (["no_such_file.py"], "no file"),
        ([Still("a", np.eye(4)), Still("a", np.zeros((4, 4)))], "two different"),
    ],
)
def test_bad_engines_are_named(task, engines, said):
    with pytest.raises(InputError, match=said):
        compare(task, engines, protocol=ONCE)


def test_engine_that_cannot_be_sent_is_refused_with_a_remedy(task):
    class Local:
        name = "local"
        register = lambda self, task: np.eye(4)  # noqa: E731

    with pytest.raises(InputError, match="file of its own"):
        compare(task, [Local()], protocol=Protocol(repeats=1))


@pytest.mark.parametrize(
    ("answer", "what"),
    [
        (None, "NoneType"),
        ("pose", "str"),
        (np.eye(3), "float64 (3, 3)"),
        (1j * np.eye(4), "complex128 (4, 4)"),
        ((np.eye(4), 0.3), "tuple"),
    ],
)
def test_an_answer_that_is_no_pose_is_an_error_of_the_engine(task, answer, what):
    (run,) = compare(task, [Still("odd", answer)], protocol=ONCE).runs
    words = f"TypeError: register returned {what}; needed: a 4x4 pose or an EngineOutput"
    assert (run.status, run.message) == ("error", words)
    assert run.success is False


def test_a_pose_that_is_partly_unknown_is_none_and_said(task):
    half = np.eye(4)
    half[0, 3] = np.inf
    runs = compare(task, [Still("half", half), Still("none", np.full((4, 4), np.nan))], protocol=ONCE).runs
    assert [(run.kind, run.self_report) for run in runs] == [("nothing", "NaN or inf in its pose"), ("nothing", "")]


def test_an_error_of_an_engine_file_names_its_line(task, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("class Mine:\n    name = 'mine'\n    def register(self, task):\n        return 1 / 0\n")
    with pytest.raises(InputError, match=r"make one of its class: ENGINE = Mine\(\)"):
        compare(task, [path], protocol=ONCE)
    path.write_text(f"{path.read_text()}ENGINE = Mine()\n")
    (run,) = compare(task, [path], protocol=ONCE).runs
    assert run.message == "ZeroDivisionError in mine.py, line 4: division by zero"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = [", "not TOML"),
        ("", "at least one axis"),
        ("[axis.nose]\nvalues=[1]", "did you mean noise"),
        ("[axis.noise]\nvalues=[]", "values"),
        ("[axis.noise]\nvalues=['much']", "noise"),
        ("[axis.noise]\nvalues=[0.1]\ntrials=0", "trials"),
        ("[axis.nothing]\nvalues=['bracket']\nsettings=['same-loop']", "needs a start"),
        ("[axis.frame]\nvalues=['yards']", "yards"),
        ("[base]\nparts='bracket'\n[axis.noise]\nvalues=[0.1]", "did you mean part"),
        ("timeout=-1\n[axis.noise]\nvalues=[0.1]", "timeout"),
        ("engines='all'\n[axis.noise]\nvalues=[0.1]", "engines"),
    ],
)
def test_sweeps_name_what_is_wrong(text, said):
    with pytest.raises(InputError, match=said):
        parse_sweep(text, "mine")


def test_shipped_sweeps_name_engines_that_exist():
    from dqreg.compare.engines.registry import ENGINES

    for name in ("standard", "quick"):
        assert set(read_sweep(name).all_engines) <= set(ENGINES)


@pytest.mark.parametrize(
    "bad",
    [
        {"repeats": 0},
        {"threads": True},
        {"timeout": 0.0},
        {"success_threshold": float("nan")},
        {"memory_limit": -1.0},
        {"memory_limit": "2 GB"},
        {"settings": "manual"},
        {"settings": ("loop",)},
    ],
)
def test_a_protocol_is_checked(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        Protocol(**bad)


def test_what_is_held_out_of_a_scan_takes_its_times_along() -> None:
    points = np.random.default_rng(0).normal(size=(2_000, 3))
    cloud = PointCloud(points, points, times=points[:, 0], units="mm")
    known = TruePoses(np.eye(4)[None], None)
    case = make_case("timed", cloud, cloud, np.eye(4), known, setting="same-loop", loop=SMALL)
    given = case.task.source
    assert (len(given), len(case.ground_truth.held_out), len(case.task.source_points)) == (1_800, 200, 500)
    np.testing.assert_array_equal(given.times, given.points[:, 0])
    few = small_copy(case.task).source
    np.testing.assert_array_equal(few.times, few.points[:, 0])
