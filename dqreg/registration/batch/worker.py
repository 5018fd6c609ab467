"""A worker process of a batch, seen from its parent: a crash or a hang in it costs one row.

A fresh interpreter, never a fork: Open3D's threads do not survive one. It talks over its standard input and output, so
that it may be started from anywhere, also from the daemonic processes of a Dask cluster.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import struct
import subprocess
import sys
import tempfile
import threading
from typing import IO, Any

from dqreg.errors import InputError
from dqreg.registration.batch.child_start import safe_environment, safe_path
from dqreg.registration.batch.row import Done, Row, Thumbnail

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
    from dqreg._open3d import load_open3d
    from dqreg.registration.batch.row import Targets, run_row

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


# Loading the libraries is not the row's doing.
START_SECONDS = 180.0
# Rows after which a process is replaced: whatever libraries leak goes with it.
RECYCLED_AFTER = 256
CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from dqreg.registration.batch.worker import serve; serve({idle})"
)


class Child:
    """A process that registers one row after another, and is replaced when it dies."""

    def __init__(self, threads: int, idle: float | None = None) -> None:
        self._threads, self._idle = threads, idle
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None
        self._rows = 0
        self._late: float | None = None
        self.closed = False
        self._lock = threading.Lock()

    def ask(self, row: Row, timeout: float | None = None, thumbnail: Thumbnail | None = None) -> Done:
        """Have a row registered; waits for it."""
        if self._rows >= RECYCLED_AFTER:
            self._end()
        for _ in range(2):
            try:
                done = self._asked(row, timeout, thumbnail)
            except (EOFError, OSError):
                code, words = self._last_words()
                self._end()
                if self._late is not None:
                    return Done("timeout", f"no answer within {self._late:g} s")
                if code == 0 and self._idle is not None:
                    continue  # it had just gone, for want of work
                return Done("crashed", words)
            self._rows += 1
            if self._late is not None:
                self._end()  # its time was up just when it was done
            return done
        return Done("crashed", words)

    def _asked(self, row: Row, timeout: float | None, thumbnail: Thumbnail | None) -> Done:
        process = self._ready()
        assert process.stdin is not None
        assert process.stdout is not None
        with self._limit(timeout):
            send(process.stdin, (row, thumbnail))
            done: Done = receive(process.stdout)
        return done

    def close(self) -> None:
        """End the process for good; whoever waits for its answer is told that it crashed."""
        self.closed = True
        self._kill()
        self._end()

    def _ready(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._end()
        with self._lock:
            if self.closed:
                raise EOFError
            process, self._log = _started(self._threads, self._idle)
            self._process = process
        with self._limit(START_SECONDS):
            assert process.stdout is not None
            trouble = receive(process.stdout)
        if trouble is not None:
            raise trouble
        return process

    @contextlib.contextmanager
    def _limit(self, seconds: float | None) -> Any:
        """Ends the process once the time is up, so that reading from it ends as well."""
        self._late = None
        if seconds is None:
            yield
            return
        timer = threading.Timer(seconds, self._too_late, (seconds,))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _too_late(self, seconds: float) -> None:
        self._late = seconds
        self._kill()

    def _kill(self) -> None:
        with self._lock:
            if self._process is not None:
                self._process.kill()

    def _last_words(self) -> tuple[int | None, str]:
        """Exit code, and how the process ended in words."""
        process, log = self._process, self._log
        if process is None:
            return None, "the worker process was ended"
        try:
            code: int | None = process.wait(5.0)
        except subprocess.TimeoutExpired:
            code = None
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        words = "the worker process died"
        if log is not None:
            with contextlib.suppress(OSError, ValueError):
                log.seek(0)
                lines = log.read()[-10_000:].decode(errors="replace").strip().splitlines()
                if lines:
                    return code, f"{words} ({how}): {lines[-1][:200]}"
        return code, f"{words} ({how})"

    def _end(self) -> None:
        with self._lock:
            process, log = self._process, self._log
            self._process = self._log = None
            self._rows = 0
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                # A request that was not taken is still in the buffer, and has nowhere to go.
                with contextlib.suppress(OSError, ValueError):
                    if pipe is not None:
                        pipe.close()
        if log is not None:
            log.close()


def _started(threads: int, idle: float | None) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
    """The process, and the file that holds what its libraries print."""
    import json

    environment = {**os.environ, **safe_environment(threads)}
    # Ctrl-C in a terminal goes to the whole group; the parent alone decides what it means.
    group: dict[str, Any] = {"process_group": 0}
    if os.name == "nt":
        group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined,unused-ignore]
    command = [sys.executable, "-P", "-c", CODE.format(idle=idle), json.dumps(safe_path(sys.path))]
    pipe = subprocess.PIPE
    try:
        log = tempfile.TemporaryFile("a+b")  # noqa: SIM115 - lives as long as the process
        try:
            return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=log, env=environment, **group), log
        except OSError:
            log.close()
            raise
    except OSError as error:
        raise InputError(f"cannot start a worker process: {error.strerror or error}; use fewer --workers") from error
