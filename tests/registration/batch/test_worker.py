from __future__ import annotations

import io
import mmap
import os
import threading
import time
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import MissingDependencyError
from dqreg.registration.batch.serve import receive, send
from dqreg.registration.batch.watch import Failure, resident_memory
from dqreg.registration.batch.worker import Worker
from tests.registration.batch.hostile import behave, refuse

GOOD, HANG, LEAVE = (partial(behave, kind) for kind in ("good", "hang", "leave"))


@pytest.fixture(scope="module")
def worker():
    """One for all: it starts another process where the test before has ended its own."""
    made = Worker(threads=1)
    yield made
    made.close()


@given(st.recursive(st.none() | st.binary(max_size=20) | st.text(), st.lists, max_leaves=5))
@settings(max_examples=40, deadline=None)
def test_messages_arrive_whole_or_not_at_all(message):
    pipe = io.BytesIO()
    send(pipe, message)
    data = pipe.getvalue()
    assert receive(io.BytesIO(data)) == message
    for cut in {0, 3, len(data) - 1}:
        with pytest.raises(EOFError):
            receive(io.BytesIO(data[:cut]))


def test_the_number_of_threads_reaches_open3d_and_the_kernels(worker):
    assert worker.call(partial(behave, "threads"), 120.0) == (1, 1)


def test_it_is_replaced_when_it_dies_is_late_or_takes_too_much(worker):
    first = worker.call(GOOD, 60.0)
    assert worker.call(GOOD) == first
    assert worker.call(LEAVE, 60.0) == Failure("crashed", "the worker process died (exit code 3)")
    assert worker.call(HANG, 0.3) == Failure("timeout", "no answer within 0.3 s")
    second = worker.call(GOOD)
    greedy = worker.call(partial(behave, "greedy"), 60.0, 400e6)
    assert (greedy.kind, greedy.message[-13:]) == ("memory", "limit 0.4 GiB")
    third = worker.call(GOOD, memory=4e9)
    assert len({first, second, third}) == 3
    for number in (first, second):
        with pytest.raises(ProcessLookupError):
            os.kill(number, 0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")
def test_what_a_task_forks_neither_answers_nor_keeps_its_caller_waiting(worker):
    worker.call(GOOD, 60.0)
    assert worker.call(partial(behave, "leave a child"), 20.0) == Failure(
        "crashed", "the worker process died (exit code 3)"
    )
    # Its last words are its own, not those of a task before it.
    worker.call(partial(behave, "speak"), 60.0)
    assert worker.call(LEAVE, 60.0).message == "the worker process died (exit code 3)"
    assert worker.call(partial(behave, "answer twice"), 60.0) == "parent"
    assert worker.call(GOOD, 60.0) > 0


def test_cpu_time_is_what_the_process_works_not_what_it_waits(worker):
    # A process that gets no core ages as one that sleeps: only work counts.
    assert worker.call(partial(behave, "wait"), cpu=0.2) > 0.4
    assert worker.call(partial(behave, "work"), cpu=0.2) == Failure("timeout", "no answer within 0.2 s of CPU time")


def test_an_error_is_the_callers(worker):
    with pytest.raises(LookupError, match="nobody home"):
        worker.call(partial(behave, "raise"))
    assert worker.call(GOOD) > 0


def test_what_every_process_needs_first_is_refused_here():
    worker = Worker(threads=1, prepare=refuse)
    with pytest.raises(MissingDependencyError, match="no such library"):
        worker.call(GOOD)
    worker.close()


def test_it_is_recycled():
    recycled = Worker(threads=1, most=1)
    try:
        assert recycled.call(GOOD) != recycled.call(GOOD)
    finally:
        recycled.close()


def test_closing_ends_the_task_and_is_for_good():
    worker = Worker(threads=1)
    timer = threading.Timer(0.5, worker.close)
    timer.start()
    assert worker.call(HANG).kind == "crashed"
    timer.join()
    assert worker.call(GOOD).kind == "crashed"


def test_it_goes_with_its_parent_even_in_the_middle_of_a_task(worker):
    worker.call(GOOD)
    process = worker._process
    thread = threading.Thread(target=worker.call, args=(HANG,))
    thread.start()
    time.sleep(0.3)
    # What the system does for a parent that was killed.
    process.stdin.close()
    assert process.wait(60.0) == 0
    thread.join()


def test_an_idle_one_leaves_and_the_next_task_starts_another():
    worker = Worker(threads=1, idle=0.1)
    try:
        first, process = worker.call(GOOD), worker._process
        assert process.wait(30.0) == 0
        assert worker.call(GOOD) not in (first, None)
    finally:
        worker.close()


def test_one_that_is_killed_while_it_stands_idle_is_replaced():
    worker = Worker(threads=1, idle=60.0)
    try:
        first, process = worker.call(GOOD), worker._process
        process.kill()
        # It may be on its way out still when the next task comes.
        second = worker.call(GOOD)
        assert not isinstance(second, Failure)
        assert second != first
    finally:
        worker.close()


def test_what_it_has_started_counts_as_its_memory(worker):
    found = worker.call(partial(behave, "a greedy child"), 20.0, 600e6)
    assert (found.kind, found.message[-13:]) == ("memory", "limit 0.6 GiB")


def test_resident_memory_is_that_of_the_process():
    # Pages of its own: an allocator may serve a block from what the tests before have freed.
    with mmap.mmap(-1, 50_000_000) as block:
        before = resident_memory(os.getpid())
        block.write(b"x" * 50_000_000)
        if before:
            assert resident_memory(os.getpid()) - before > 45e6
    assert resident_memory(-1) == 0.0
