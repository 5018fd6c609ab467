"""What the page is told when something goes wrong: a sentence, and where its trace was written if it is our mistake."""

from __future__ import annotations

import datetime
import os
import traceback
from typing import TYPE_CHECKING, Any

from dqreg.errors import DqregError
from dqreg.files.atomic import write_atomically
from dqreg.studio.sessions import BrokenError, Sessions, StoppedError

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

# File of a visit, or of all of them, that holds the last mistake.
TRACE = "trace.txt"
BROKEN = (
    "The calculation ended before it was done ({}). Nothing that you chose is lost: press the button again, and if it "
    "ends again, try fewer points."
)
MISTAKE = "This is a mistake of dqreg, not of yours ({}). Nothing that you chose is lost. {}"
KEPT = "Where it happened is written in {}: please send that file with a report of the mistake."


class Troubles:
    """Answers to requests that failed."""

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions

    @property
    def handlers(self) -> Any:
        """What answers which error."""
        return {DqregError: self.refused, StoppedError: self.stopped, BrokenError: self.broken, Exception: self.mistake}

    async def refused(self, request: Request, error: Exception) -> Response:
        """What is wrong, in a sentence; a file is called by its name, wherever it lies here."""
        return _answer(422, error=self._without_folders(request, str(error)))

    async def stopped(self, request: Request, error: Exception) -> Response:
        """A run that was to end."""
        return _answer(409, stopped=True)

    async def broken(self, request: Request, error: Exception) -> Response:
        """A run that ended by itself."""
        return _answer(503, error=BROKEN.format(error))

    async def mistake(self, request: Request, error: Exception) -> Response:
        """An error that nobody has thought of: in words, with its trace in the folder of the visit."""
        session = self._sessions.by_name.get(request.path_params.get("visit", ""))
        place = (self._sessions.folder if session is None else session.folder) / TRACE
        what = f"{type(error).__name__}: {error}"[:300]
        # A visit's is handed out by its name; where there is none, only its path leads to it.
        name = str(place) if session is None else f"{TRACE} in the folder of this visit"
        try:
            write_atomically(place, _trace(request, error))
        except DqregError as full:
            said = f"Where it happened could not be written: {full}"
            return _answer(500, error=self._without_folders(request, MISTAKE.format(what, said)))
        words = MISTAKE.format(self._without_folders(request, what), KEPT.format(name))
        return _answer(500, error=words, file=None if session is None else TRACE)

    def _without_folders(self, request: Request, words: str) -> str:
        sessions = self._sessions
        session = sessions.by_name.get(request.path_params.get("visit", ""))
        folders = [sessions.folder, *(each.folder for each in (sessions.many, sessions.travel) if each is not None)]
        if session is not None:
            sides = [side for side in (session.visit.scan, session.visit.part) if side is not None]
            folders += [session.folder, *((session.folder / side.path).parent for side in sides)]
        for folder in sorted(map(str, folders), key=len, reverse=True):
            words = words.replace(f"{folder}{os.sep}", "")
        return words


def _trace(request: Request, error: Exception) -> str:
    from dqreg import __version__

    when = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    # The path without the key of the page: this is sent away.
    asked = f"{request.method} {request.scope['path']}"
    return f"dqreg {__version__}, {when}, {asked}\n\n{''.join(traceback.format_exception(error))}"


def _answer(status: int, **values: Any) -> Response:
    from starlette.responses import JSONResponse

    return JSONResponse({name: value for name, value in values.items() if value is not None}, status)
