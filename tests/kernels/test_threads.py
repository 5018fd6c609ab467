from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from concurrent.futures import Future

import numpy as np
import pytest

from dqreg.kernels import threads
from tests.registration.batch.scenes import environment


def mark(first: int, last: int, rows: np.ndarray) -> None:
    rows[first:last] += 1


@pytest.mark.parametrize("total", [0, 1, 99, 100, 101, 1_234])
@pytest.mark.parametrize("count", [1, 3])
def test_each_row_once(monkeypatch: pytest.MonkeyPatch, total: int, count: int) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    rows = np.zeros(total, dtype=int)
    threads.over_chunks(mark, total, rows, chunk=100)
    assert (rows == 1).all()


def test_ranges_within_a_range_are_of_its_own_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: 4)
    rows, strangers = np.zeros(1_000, dtype=int), []

    def outer(first: int, last: int) -> None:
        me = threading.get_ident()

        def inner(begin: int, end: int) -> None:
            rows[first + begin : first + end] += 1
            if threading.get_ident() != me:
                strangers.append(begin)
            time.sleep(1e-4)

        threads.over_chunks(inner, last - first, chunk=10)

    threads.over_chunks(outer, 1_000, chunk=100)
    assert (rows == 1).all()
    assert not strangers


@pytest.mark.parametrize(("total", "helpers"), [(8, 0), (9, 0), (15, 0), (16, 1), (31, 2), (800, 3)])
def test_helpers_are_asked_for_whole_ranges_alone(monkeypatch: pytest.MonkeyPatch, total: int, helpers: int) -> None:
    asked: list[object] = []
    monkeypatch.setattr(threads, "thread_count", lambda: 4)
    monkeypatch.setattr(threads, "_submit", asked.append)
    seen: list[int] = []
    threads.over_chunks(lambda first, last: seen.extend(range(first, last)), total, chunk=8)
    assert len(asked) == helpers
    assert seen == list(range(total))
    asked.clear()
    threads.over_chunks(lambda first, last: seen.extend(range(first, last)), total, chunk=8, fewest=4)
    assert len(asked) == (helpers if total >= 32 else 0)
    assert seen == 2 * list(range(total))


@pytest.mark.parametrize(("handed_over", "helpers"), [(np.inf, 0), (0.0, 3)])
def test_what_is_quicker_than_handed_over_is_done_by_the_caller(
    monkeypatch: pytest.MonkeyPatch, handed_over: float, helpers: int
) -> None:
    asked: list[object] = []
    monkeypatch.setattr(threads, "thread_count", lambda: 4)
    monkeypatch.setattr(threads, "_submit", asked.append)
    monkeypatch.setattr(threads, "HANDED_OVER", handed_over)
    rows = np.zeros(1_234, dtype=int)
    threads.over_chunks(mark, 1_234, rows, chunk=100, may_be_quick=True)
    assert (rows == 1).all()
    assert len(asked) == helpers


def test_a_helper_that_never_begins_holds_no_array(monkeypatch: pytest.MonkeyPatch) -> None:
    waiting: list[tuple[object, ...]] = []

    def queue(*call: object) -> Future[None]:
        waiting.append(call)
        return Future()

    monkeypatch.setattr(threads, "thread_count", lambda: 2)
    monkeypatch.setattr(threads, "_submit", queue)
    rows = np.zeros(1_000, dtype=int)
    held = weakref.ref(rows)
    threads.over_chunks(mark, 1_000, rows, chunk=100)
    assert (rows == 1).all()
    assert len(waiting) == 1
    del rows
    assert held() is None


def test_what_was_made_beside_does_not_hold_what_it_was_made_of(monkeypatch: pytest.MonkeyPatch) -> None:
    class Owner:
        later: threads.Later[int]

    monkeypatch.setattr(threads, "thread_count", lambda: 2)
    owner = Owner()
    owner.later = threads.Later(lambda owner=owner: 7 if owner else 0)
    while not owner.later.is_begun:
        time.sleep(1e-3)
    assert owner.later.result() == 7
    # As in a child of a fork, where the thread that was at it is none.
    late = threads.Later(lambda: time.sleep(0.2))
    while not late.is_begun:
        time.sleep(1e-3)
    late._process = -1
    assert not late.is_begun
    late.result()
    assert late.is_begun
    held = weakref.ref(owner)
    gc.disable()
    del owner
    try:
        assert held() is None
    finally:
        gc.enable()


def test_an_error_is_raised_and_ends_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: 2)

    def fails(first: int, last: int) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        threads.over_chunks(fails, 100, chunk=10)


def test_eight_callers_at_once_get_each_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: 4)
    rows = np.zeros((8, 5_000), dtype=int)
    callers = [
        threading.Thread(target=threads.over_chunks, args=(mark, 5_000, row), kwargs={"chunk": 50}) for row in rows
    ]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert (rows == 1).all()


@pytest.mark.parametrize(("asked", "most"), [("1", 1), ("0", None), ("all", None), ("100000", None)])
def test_threads_are_those_asked_for_and_no_more_than_cores(
    monkeypatch: pytest.MonkeyPatch, asked: str, most: int | None
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert 1 <= threads.thread_count() <= (most or os.cpu_count() or 1)


FORKED = """
import multiprocessing, os, sys
import numpy as np
from dqreg.kernels import threads
threads.thread_count = lambda: 3
from dqreg.kernels.trees.triangle_tree import TriangleTree
rng = np.random.default_rng(0)
corners, queries = rng.normal(size=(60, 3, 3)), rng.normal(size=(9_000, 3))
normals = np.tile([0.0, 0.0, 1.0], (60, 1))
def job(_):
    return TriangleTree.of(corners, normals).closest(queries)[2].sum()
if __name__ == "__main__":
    # The pool has run before the fork; one that is made at import hangs here.
    here = job(0)
    for way in sys.argv[1:]:
        # A child that does not inherit the package loads it for seconds: one of each kind will do.
        with multiprocessing.get_context(way).Pool(2 if way == "fork" else 1) as pool:
            assert pool.map_async(job, range(4)).get(timeout=60) == [here] * 4, way
    print("same")
"""


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
def test_the_same_after_fork_spawn_and_forkserver(tmp_path) -> None:
    file = tmp_path / "forked.py"
    file.write_text(FORKED, encoding="utf-8")
    words = [sys.executable, "-W", "ignore", str(file), "fork", "forkserver", "spawn"]
    done = subprocess.run(words, env=environment(), capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (0, "same\n"), done.stderr


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_an_interrupt_is_seen_between_ranges_and_beside_a_long_kernel() -> None:
    ran, released, ended = [], threading.Event(), threading.Event()

    def chunk(first: int, last: int) -> None:
        ran.append(first)
        time.sleep(0.02)

    def kernel() -> None:
        released.wait(60.0)
        ended.set()

    # A process that was started in the background may have been told to ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        for call in (lambda: threads.over_chunks(chunk, 500, chunk=1), lambda: threads.aside(kernel)):
            timer = threading.Timer(0.1, os.kill, [os.getpid(), signal.SIGINT])
            timer.daemon = True
            timer.start()
            with pytest.raises(KeyboardInterrupt):
                call()
    finally:
        signal.signal(signal.SIGINT, before)
    # Neither went on to its end.
    assert len(ran) < 500
    assert not ended.is_set()
    released.set()


def test_at_the_end_of_the_interpreter_the_caller_works_alone() -> None:
    code = """
import atexit
from dqreg.kernels import threads
threads.thread_count = lambda: 3
rows = []
def late():
    threads.over_chunks(lambda first, last: rows.append(first), 5, chunk=2)
    print(rows, threads.aside(abs, -1))
threads.aside(abs, -1)
atexit.register(late)
"""
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("[0, 2, 4] 1\n", "")


def test_a_deadline_is_seen_between_two_ranges() -> None:
    done = []
    with pytest.raises(threads.TimeUpError), threads.until(time.perf_counter() - 1.0):
        threads.over_chunks(lambda first, last: done.append(first), 10, chunk=1)
    assert done == []
    with threads.until(time.perf_counter() - 1.0), threads.until(np.inf):
        threads.over_chunks(lambda first, last: done.append(first), 10, chunk=1)
    assert sorted(done) == list(range(10))
    threads.ask_clock()


@pytest.mark.parametrize("count", [1, 2])
def test_what_is_begun_is_made_once_with_the_deadline_of_its_beginning(
    monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    made = []
    begun = threads.Later(lambda: made.append(1) or "found")
    assert [begun.result(), begun.result(), made] == ["found", "found", [1]]
    with pytest.raises(ZeroDivisionError):
        threads.Later(lambda: 1 // 0).result()
    began = threading.Event()
    with threads.until(time.perf_counter() - 1.0):
        late = threads.Later(lambda: (began.set(), threads.ask_clock()))
    if count > 1:
        assert began.wait(30.0)
        with pytest.raises(threads.TimeUpError):
            late.result()


@pytest.mark.parametrize("count", [1, 2])
def test_all_results_come_in_order_from_the_caller_at_the_end_and_others_at_the_beginning(
    monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: count)
    here, at_first, at_last = threading.get_ident(), threading.Event(), threading.Event()

    def work(k: int) -> tuple[int, bool]:
        # With another thread, the first and the last are computed at once: each waits for the other to have begun.
        if count > 1 and k in (0, 4):
            (at_first if k == 0 else at_last).set()
            assert (at_last if k == 0 else at_first).wait(30.0)
        return k, threading.get_ident() == here

    found = threads.all_results([threads.Later(lambda k=k: work(k)) for k in range(5)])
    assert [k for k, _ in found] == list(range(5))
    assert (found[0][1], found[4][1]) == (count == 1, True)


def test_callers_that_all_have_stages_beside_them_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "thread_count", lambda: 3)
    rows = np.zeros((8, 2, 3_000), dtype=int)

    def stage(row: np.ndarray) -> int:
        threads.over_chunks(mark, 3_000, row, chunk=50)
        return threads.aside(abs, -1)

    def caller(pair: np.ndarray) -> None:
        for _ in range(5):
            first = threads.Later(lambda: stage(pair[0]))
            second = threads.Later(lambda first=first: first.result() + stage(pair[1]))
            assert second.result() == 2

    callers = [threading.Thread(target=caller, args=(pair,), daemon=True) for pair in rows]
    for each in callers:
        each.start()
    ends = time.perf_counter() + 30.0
    for each in callers:
        each.join(max(ends - time.perf_counter(), 0.0))
    assert not any(each.is_alive() for each in callers)
    assert (rows >= 5).all()
    assert not threads._running
