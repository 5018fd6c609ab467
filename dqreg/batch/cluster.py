"""The door to a Dask cluster: connects, looks whether its workers can work, and says in words what is wrong."""

from __future__ import annotations

import contextlib
import importlib
import logging
from collections.abc import Iterator
from typing import Any

from dqreg.errors import InputError, MissingDependencyError

CONNECT_SECONDS = 20


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of a running cluster."""
    distributed = load_distributed()
    with _quiet():
        try:
            client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"no Dask scheduler answers at {address}: {str(error).splitlines()[0]}") from error
        try:
            _require_dqreg(client, address)
            yield client
        finally:
            # A scheduler that is gone must not hold up the end.
            with contextlib.suppress(Exception):
                client.close(timeout=5)


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
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise MissingDependencyError(
            f"a Dask cluster needs the package distributed ({error}); run: pip install 'dqreg[cluster]'"
        ) from error


def slots(client: Any) -> int:
    """How many tasks the cluster runs at once, as of now."""
    return sum(client.nthreads().values())


def _require_dqreg(client: Any, address: str) -> None:
    import dqreg

    try:
        client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        versions = client.run(_version)
    except TimeoutError as error:
        # In safe-path mode: Dask's own processes import from their working folder as well.
        raise InputError(
            f"the Dask cluster at {address} has no workers; start one: python -P -m dask worker {address}"
        ) from error
    except ImportError as error:
        raise InputError(f"the workers at {address} cannot load dqreg ({error}); install it where they run") from error
    other = {str(version) for version in versions.values()} - {dqreg.__version__}
    if other:
        raise InputError(
            f"the workers at {address} have dqreg {', '.join(sorted(other))}, and here is {dqreg.__version__}; install "
            f"the same on both sides"
        )


def _version() -> str:
    import dqreg

    return dqreg.__version__
