"""The way to a Dask cluster: every question has an end, and every failure one line."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.metadata
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from dqreg.errors import InputError, load_package

# Whether a scheduler is there and has workers is known within ten seconds; workers that load libraries get more.
CONNECT_SECONDS, WORKER_SECONDS = 3.0, 60.0
Found = TypeVar("Found")


def within(seconds: float, act: Callable[[], Found]) -> Found:
    """What a call comes to, in seconds: Dask itself waits for ever for some answers."""
    box: list[tuple[Any, BaseException | None]] = []

    def work() -> None:
        try:
            box.append((act(), None))
        except BaseException as error:
            box.append((None, error))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    if not box:
        raise TimeoutError(f"no answer within {seconds:g} s")
    value, error = box[0]
    if error is not None:
        raise error
    found: Found = value
    return found


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of a running cluster."""
    distributed = load_distributed()
    with _quiet():
        try:
            within(CONNECT_SECONDS, lambda: asyncio.run(_greeted(address)))
            client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except Exception as error:
            # A port of something else answers in any way it likes.
            said = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise InputError(f"no Dask scheduler answers at {address}: {said}") from error
        try:
            _require_dqreg(client, address)
            yield client
        finally:
            # A scheduler that is gone must not hold up the end.
            with contextlib.suppress(Exception):
                within(5.0, lambda: client.close(timeout=5))


async def _greeted(address: str) -> None:
    """Raise unless a scheduler answers."""
    comm: Any = await load_distributed().comm.connect(address, timeout=CONNECT_SECONDS)
    try:
        await comm.write({"op": "identity", "reply": True})
        found = await comm.read()
        if not isinstance(found, dict) or found.get("type") != "Scheduler":
            raise OSError(f"what answers is no scheduler ({found!r:.60})")
    finally:
        comm.abort()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """What Dask logs about lost connections, page after page, is said by one error of ours."""
    names = ["distributed", *(name for name in logging.root.manager.loggerDict if name.startswith("distributed."))]
    before = [(logging.getLogger(name), logging.getLogger(name).level) for name in names]
    for logger, _ in before:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in before:
            logger.setLevel(level)


def load_distributed() -> Any:
    """The package ``distributed``."""
    return load_package("distributed", "'dqreg[cluster]'", "a Dask cluster")


def _require_dqreg(client: Any, address: str) -> None:
    try:
        within(CONNECT_SECONDS, lambda: client.wait_for_workers(1, timeout=CONNECT_SECONDS))
    except TimeoutError as error:
        # In safe-path mode: Dask's own processes import from their working folder as well.
        raise InputError(
            f"the Dask cluster at {address} has no workers; start one: python -P -m dask worker {address}"
        ) from error
    try:
        there = within(WORKER_SECONDS, lambda: client.run(_versions))
    except TimeoutError as error:
        raise InputError(f"the workers at {address} do not answer: are they stopped, or overloaded?") from error
    except Exception as error:
        # What Python 3.11 packs, another one cannot always unpack; then the workers cannot even say which they are.
        found = (str(error).strip().splitlines() or [type(error).__name__])[0]
        versions = ", ".join(f"{name} {version}" for name, version in _versions().items())
        raise InputError(
            f"the workers at {address} cannot load dqreg ({found}); install it where they run, with {versions}"
        ) from error
    here = _versions()
    for name, version in here.items():
        other = {str(versions.get(name)) for versions in there.values()} - {version}
        if other:
            raise InputError(
                f"the workers at {address} have {name} {', '.join(sorted(other))}, and here is {version}; install the "
                "same on both sides"
            )


def _versions() -> dict[str, str]:
    """What must be the same on both sides, for tasks and results to be understood."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {name: importlib.metadata.version(name) for name in ("dqreg", "distributed")} | {"Python": python}
