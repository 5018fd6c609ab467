"""Chunks of one scan on the workers of a Dask cluster, and what they answer."""

from __future__ import annotations

import contextlib
import secrets
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from dqreg.batch.cluster import connected, slots
from dqreg.batch.scheduler import CANCELLED
from dqreg.batch.sums import Question, Sums, measure, split
from dqreg.errors import DqregError, InputError

if TYPE_CHECKING:
    from dqreg.geometry import Mesh, PointCloud, Scan
    from dqreg.target import IndexedTarget

# Times that a chunk is sent again because its worker has died, a step.
ATTEMPTS = 4
ANSWER_SECONDS = 600.0

# Surface that this Dask worker has built last; one is enough, and a second would only hold memory.
_surfaces: dict[str, IndexedTarget] = {}
_lock = threading.Lock()


@contextlib.contextmanager
def on_workers(
    address: str, scan: Scan, target: IndexedTarget, chunks: int | None = None
) -> Iterator[Callable[[Question], list[Sums]]]:
    """Send the target and the chunks of a scan to the workers, once.

    Parameters
    ----------
    address : str
        Of the scheduler.
    scan : Scan
        All points; this process keeps them, so that a chunk whose worker dies is sent to another one.
    target : IndexedTarget
        In its centred frame.
    chunks : int, optional
        By default one a thread of the cluster.

    Yields
    ------
    callable
        From a question to the sums of each chunk, always in the same order.

    Raises
    ------
    InputError
        If the cluster cannot be used.
    """
    with connected(address) as client:
        fleet = _Fleet(client, split(scan, chunks or max(1, slots(client))), target.geometry)
        try:
            yield fleet.ask
        finally:
            fleet.close()


class _Fleet:
    """Where each chunk is, and how to get it there again."""

    def __init__(self, client: Any, parts: list[Scan], geometry: Mesh | PointCloud) -> None:
        self._client, self._parts, self._geometry = client, parts, geometry
        self._token = secrets.token_hex(8)
        self._sent: list[Any] = client.scatter(parts, hash=False)
        self._target: Any = client.scatter(geometry, hash=False, broadcast=True)

    def ask(self, question: Question) -> list[Sums]:
        answers: dict[int, Sums] = {}
        for _ in range(ATTEMPTS):
            missing = [number for number in range(len(self._parts)) if number not in answers]
            if not missing:
                break
            asked = {number: self._submitted(number, question) for number in missing}
            for number, future in asked.items():
                answer = self._answer(future)
                if answer is not None:
                    answers[number] = answer
        if len(answers) < len(self._parts):
            raise InputError(
                f"{len(self._parts) - len(answers)} of {len(self._parts)} chunks found no Dask worker that lived long "
                f"enough; give smaller chunks, or workers more memory"
            )
        return [answers[number] for number in range(len(self._parts))]

    def close(self) -> None:
        with contextlib.suppress(Exception, *CANCELLED):
            self._client.cancel([*self._sent, self._target])
            self._client.run(forget, self._token)

    def _submitted(self, number: int, question: Question) -> Any:
        # Data that went with its worker is sent again; Dask can repeat tasks, but not what was given to it.
        if self._target.status != "finished":
            self._target = self._client.scatter(self._geometry, hash=False, broadcast=True)
        if self._sent[number].status != "finished":
            self._sent[number] = self._client.scatter(self._parts[number], hash=False)
        return self._client.submit(
            answer, self._sent[number], self._target, self._token, question, pure=False, retries=1
        )

    def _answer(self, future: Any) -> Sums | None:
        try:
            found: Sums = future.result(timeout=ANSWER_SECONDS)
        except DqregError:
            raise
        except TimeoutError:
            future.cancel()
            return None
        except (Exception, *CANCELLED) as error:
            if type(error).__module__.partition(".")[0] not in ("distributed", "asyncio", "concurrent", "builtins"):
                raise
            return None
        return found


def answer(part: Scan, geometry: Mesh | PointCloud, token: str, question: Question) -> Sums:
    """Sums of one chunk; runs on a worker, which builds the target's trees once.

    Parameters
    ----------
    part : Scan
        The chunk.
    geometry : Mesh or PointCloud
        The target in its centred frame.
    token : str
        Names the target.
    question : Question
        Pose and kernel.

    Returns
    -------
    Sums
        A few hundred numbers.
    """
    return measure(part, _target(geometry, token).surface, question)


def _target(geometry: Mesh | PointCloud, token: str) -> IndexedTarget:
    import numpy as np

    from dqreg.target import IndexedTarget

    with _lock:
        if token not in _surfaces:
            _surfaces.clear()
            _surfaces[token] = IndexedTarget(geometry, np.zeros(3))
        return _surfaces[token]


def forget(token: str) -> None:
    """Let go of a target; runs on a worker.

    Parameters
    ----------
    token : str
        As in `answer`.
    """
    with _lock:
        _surfaces.pop(token, None)
