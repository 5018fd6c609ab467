"""A process of its own for work that may crash, hang or exhaust the memory: that costs one task, never the program.

A fresh interpreter, not a fork: Open3D's threads do not survive one. It talks over its standard input and output, so
that it may be started from anywhere, also from the daemonic processes of a Dask cluster. No file of the working folder,
whatever its name, is taken for a module of the standard library.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, Literal, TypeVar

from dqreg.errors import InputError
from dqreg.registration.batch.serve import receive, send
from dqreg.registration.batch.watch import Failure, Watch, kill

# How a task ends: "ran" and "error" are told by the task itself, the others by the process around it.
Status = Literal["ran", "error", "crashed", "timeout", "memory"]
Result = TypeVar("Result")

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
# Starting Python and loading libraries is not the task's doing.
START_SECONDS = 180.0
# Nothing is imported before the path is the safe one.
CODE = "import sys; sys.path[:] = sys.argv[1:]; from dqreg.registration.batch.serve import serve; serve({idle})"


class Worker:
    """A worker process: does one task after another, and is replaced when it dies."""

    def __init__(
        self,
        threads: int,
        *,
        prepare: Callable[[], None] | None = None,  # First task of every process; what it raises is raised here
        most: float = float("inf"),  # Tasks after which the process is replaced: what libraries leak goes with it
        idle: float | None = None,  # Seconds without a task after which the process ends by itself
    ) -> None:
        self._threads, self._prepare, self._most, self._idle = threads, prepare or _nothing, most, idle
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None
        self._tasks = 0
        self._said = 0  # Bytes of the log that tasks before this one have printed
        self.closed = False
        self._lock = threading.Lock()

    def call(
        self,
        task: Callable[[], Result],
        timeout: float | None = None,
        memory: float | None = None,
        *,
        cpu: float | None = None,
    ) -> Result | Failure:
        """Wait for a task, within seconds, bytes and CPU seconds: a function of a module, or a `partial` of one."""
        if self._tasks >= self._most:
            self._end()
        for _ in range(2):
            watch = Watch(timeout, memory, cpu)
            try:
                self._ready(watch)
                answer: Result = self._asked(task, watch)
            except (EOFError, OSError):
                code, words = self._last_words()
                self._end()
                if watch.failure is not None:
                    return watch.failure
                if code == 0 and self._idle is not None:
                    continue  # it had just ended, for want of work
                return Failure("crashed", words)
            except BaseException:
                # An answer that nobody waits for any more would be taken for that of the next task.
                self._end()
                raise
            self._tasks += 1
            if watch.failure is not None:
                self._end()  # its time was up just when it was done
            return answer
        return Failure("crashed", words)

    def close(self) -> None:
        """End the process for good; whoever waits for its answer is told that it crashed."""
        self.closed = True
        with self._lock:
            if self._process is not None:
                kill(self._process)
        self._end()

    def _ready(self, watch: Watch) -> None:
        """See to it that there is a process."""
        if self._process is not None and self._process.poll() is None and (self._idle is None or self._answers()):
            return
        self._end()
        with self._lock:
            if self.closed:
                raise EOFError
            self._process, self._log = _started(self._threads, self._idle)
        start = Watch(START_SECONDS, None)
        try:
            self._asked(self._prepare, start)
        finally:
            watch.failure = start.failure

    def _answers(self) -> bool:
        """Whether a process that stood idle is still there: that it was killed is not the doing of the next task."""
        watch = Watch(START_SECONDS, None)
        with contextlib.suppress(EOFError, OSError):
            self._asked(_nothing, watch)
            return watch.failure is None
        return False

    def _asked(self, task: Callable[[], Result], watch: Watch) -> Result:
        process = self._process
        if process is None:
            raise EOFError  # closed meanwhile
        assert process.stdin is not None
        assert process.stdout is not None
        data = pickle.dumps(task, protocol=pickle.HIGHEST_PROTOCOL)
        self._said = 0 if self._log is None else os.fstat(self._log.fileno()).st_size
        with watch.over(process):
            send(process.stdin, (_main_script(data), data))
            result, error = receive(process.stdout)
        if error is not None:
            raise error
        found: Result = result
        return found

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
        words = f"the worker process died ({how})"
        if log is not None:
            with contextlib.suppress(OSError, ValueError):
                log.seek(self._said)
                lines = log.read()[-10_000:].decode(errors="replace").strip().splitlines()
                if lines:
                    return code, f"{words}: {lines[-1][:200]}"
        return code, words

    def _end(self) -> None:
        with self._lock:
            process, log = self._process, self._log
            self._process = self._log = None
            self._tasks = 0
        if process is not None:
            kill(process)
            process.wait()
            for pipe in (process.stdin, process.stdout):
                # A task that was not taken is still in the buffer, and has nowhere to go.
                with contextlib.suppress(OSError, ValueError):
                    if pipe is not None:
                        pipe.close()
        if log is not None:
            log.close()


def _started(threads: int, idle: float | None) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
    """The process, and the file that holds what its libraries print."""
    # Ctrl-C in a terminal goes to the whole group; the parent alone decides what it means.
    group: dict[str, Any] = {"process_group": 0}
    if os.name == "nt":
        group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined,unused-ignore]
    flags = ["-E"] if sys.flags.ignore_environment else []
    command = [sys.executable, *flags, "-P", "-c", CODE.format(idle=idle), *safe_path(sys.path)]
    environment = {**os.environ, **safe_environment(threads)}
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


def safe_environment(threads: int) -> dict[str, str]:
    """Variables of a worker: its threads, and safe-path mode, which its own children inherit."""
    return {**{name: str(threads) for name in THREAD_VARIABLES}, "PYTHONSAFEPATH": "1"}


def safe_path(entries: Sequence[str]) -> list[str]:
    """A module search path with the standard library first, so that nothing else can stand in for it."""
    places = list(entries)
    # An empty entry is the working folder. It stays on the path: dqreg itself or an engine may lie in it.
    with contextlib.suppress(FileNotFoundError):
        places = [entry or os.getcwd() for entry in entries]  # noqa: PTH109 - a path is text
    return sorted(places, key=lambda place: not _is_standard(Path(place)))


def _is_standard(place: Path) -> bool:
    folders = {Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")}
    place = place.resolve()
    packed = f"python{sys.version_info.major}{sys.version_info.minor}.zip"
    return place in folders or place.name == packed or (place.name == "lib-dynload" and place.parent in folders)


def _main_script(data: bytes) -> dict[str, Any]:
    """Where the worker finds what a task took from the caller's own script; the same rule as in `multiprocessing`."""
    if b"__main__" not in data:
        return {}
    from multiprocessing.spawn import get_preparation_data

    found = get_preparation_data("worker")
    return {name: found[name] for name in ("init_main_from_name", "init_main_from_path") if name in found}


def _nothing() -> None:
    """Do nothing: that it was done shows that the process has started."""
