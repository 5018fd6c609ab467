"""The inside of a worker process, and the messages between it and its parent."""

from __future__ import annotations

import os
import pickle
import queue
import struct
import threading
import traceback
from collections.abc import Callable
from typing import IO, Any

from dqreg.errors import DqregError

LENGTH = struct.Struct("<Q")


def send(stream: IO[bytes], message: Any) -> None:
    """Write a message to a pipe."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(LENGTH.pack(len(data)) + data)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read a message that `send` wrote."""
    head = stream.read(LENGTH.size)
    if len(head) < LENGTH.size:
        raise EOFError
    (length,) = LENGTH.unpack(head)
    data = stream.read(length)
    if len(data) < length:
        raise EOFError
    return pickle.loads(data)


def serve(idle: float | None = None) -> None:
    """Do tasks that come over standard input until the parent hangs up; runs in the worker process."""
    asked, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # What libraries print goes to the log, which is standard error: on the pipe it would garble the answers.
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    tasks: queue.SimpleQueue[tuple[dict[str, Any], bytes]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(asked, tasks), daemon=True).start()
    own = os.getpid()
    while True:
        try:
            main, data = tasks.get(timeout=idle)
        except queue.Empty:
            os._exit(0)
        answer: tuple[Any, Exception | None]
        try:
            answer = _task(main, data)(), None
        except Exception as error:
            # A trace is not sent with its error; where that is no refusal of ours, it is all that can be known.
            if not isinstance(error, DqregError):
                error.add_note("in the worker process: " + "".join(traceback.format_exception(error)))
            answer = None, error
        if os.getpid() != own:
            os._exit(0)  # a task that forked: its parent answers
        send(answers, answer)


def _listen(asked: IO[bytes], tasks: queue.SimpleQueue[Any]) -> None:
    # A thread of its own, so that a parent that is killed takes its workers along, even in the middle of a task.
    try:
        while True:
            tasks.put(receive(asked))
    except (EOFError, OSError):
        os._exit(0)


def _task(main: dict[str, Any], data: bytes) -> Callable[[], Any]:
    if main:
        from multiprocessing.spawn import prepare

        prepare(main)
    task: Callable[[], Any] = pickle.loads(data)
    return task
