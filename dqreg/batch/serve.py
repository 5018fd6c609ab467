"""The inside of a worker process: takes rows from its parent, hands back what came of them, ends with its parent."""

from __future__ import annotations

import os
import pickle
import queue
import struct
import threading
from typing import IO, Any

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
    """Do what the parent says over standard input and output, until it hangs up."""
    asked, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # What libraries print goes to the log, which is standard error: on the pipe it would garble the answers.
    os.dup2(2, 1)
    requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(asked, requests), daemon=True).start()
    from dqreg.batch.row import Targets, run_row
    from dqreg.open3d_gate import load_open3d

    targets = Targets()
    ready: Exception | None = None
    try:
        load_open3d()
    except Exception as error:
        ready = error
    send(answers, ready)
    while True:
        try:
            row, thumbnail = requests.get(timeout=idle)
        except queue.Empty:
            os._exit(0)
        send(answers, run_row(row, targets, thumbnail))


def _listen(asked: IO[bytes], requests: queue.SimpleQueue[Any]) -> None:
    # A thread of its own, so that a parent that is killed takes its workers along, even in the middle of a row.
    try:
        while True:
            requests.put(receive(asked))
    except (EOFError, OSError):
        os._exit(0)
