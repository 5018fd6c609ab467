"""The studio's server from its start to its end."""

from __future__ import annotations

import contextlib
import secrets
import signal
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.errors import InputError, MissingDependencyError
from dqreg.studio.sessions import Sessions

if TYPE_CHECKING:
    from dqreg.studio.travel import Drive, Travel

MAX_BACKLOG = 128
NEEDED = "the studio needs {}; run: pip install 'dqreg[studio]'"


def serve(
    scan: Path | None,
    part: Path | None,
    *,
    port: int = 0,
    folder: Path | None = None,
    batch: Path | None = None,
    odometry: Path | None = None,
    drive: Drive | None = None,
    browser: bool = True,
    tell: Callable[[str], object],
) -> None:
    """Serve the page until the process is told to end."""
    try:
        import starlette  # noqa: F401
        import uvicorn
    except ImportError as error:
        raise MissingDependencyError(NEEDED.format(error.name)) from error
    from dqreg.studio.many_parts import Many
    from dqreg.studio.server import application

    many = None if batch is None else Many(batch.absolute())
    with _folder(folder) as home, _socket(port) as listening:
        travel = None if odometry is None or drive is None else _travel(odometry.absolute(), home, drive)
        sessions, token = Sessions(home, scan, part, many, travel), secrets.token_urlsafe(24)
        number = listening.getsockname()[1]
        address = f"http://127.0.0.1:{number}/{token}/"
        app = application(sessions, token, number)
        config = uvicorn.Config(
            app, log_level="critical", access_log=False, timeout_graceful_shutdown=1, lifespan="off", ws="none"
        )
        # All that the first answer needs is there before anybody asks for it.
        config.load()
        tell(address)
        if browser:
            import webbrowser

            webbrowser.open(address)
        try:
            _quiet(uvicorn.Server)(config).run(sockets=[listening])
        finally:
            sessions.close()


def _travel(scans: Path, home: Path, drive: Drive) -> Travel:
    from dqreg.studio.travel import Travel

    return Travel(scans, home / f"odometry-{secrets.token_hex(4)}", drive)


def _quiet(server: type[Any]) -> type[Any]:
    """A server that ends as it should at Ctrl-C: to its user that is no error."""

    class Quiet(server):  # type: ignore[misc]
        """Hears signals, and does not raise them again afterwards."""

        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            """Whoever listened before listens again at the end."""
            numbers = (signal.SIGINT, signal.SIGTERM)
            before = {number: signal.signal(number, self.handle_exit) for number in numbers}
            try:
                yield
            finally:
                for number, handler in before.items():
                    signal.signal(number, handler)

    return Quiet


@contextlib.contextmanager
def _folder(given: Path | None) -> Iterator[Path]:
    if given is None:
        with tempfile.TemporaryDirectory(prefix="dqreg-studio-") as made:
            yield Path(made)
        return
    try:
        given.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot keep visits in {given}: {error.strerror or error}") from error
    yield given.absolute()


@contextlib.contextmanager
def _socket(port: int) -> Iterator[socket.socket]:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
            # From now on: a browser that is faster than the server waits for it, and is not refused.
            listening.listen(MAX_BACKLOG)
        except OSError as error:
            raise InputError(f"port {port} is taken ({error.strerror}); leave --port out to take a free one") from error
        yield listening
    finally:
        listening.close()
