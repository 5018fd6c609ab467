"""The local server of the studio: one page, its visits, and nothing that any other machine could ask for."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.resources
import json
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.errors import InputError
from dqreg.files.strict_json import plain
from dqreg.studio import uploads
from dqreg.studio.equivalent_commands import cleaned_name, commands_of
from dqreg.studio.guard import REPORT_POLICY, App, Guard
from dqreg.studio.plans import with_plan
from dqreg.studio.sessions import Session, Sessions
from dqreg.studio.tasks import NAMES
from dqreg.studio.troubles import TRACE, Troubles
from dqreg.studio.visit import PROGRESS, Visit

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

# Files of the page by their names, and the two that it shares with the reports.
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
SHARED = ("view3d.js", "base.css")
# What may be fetched of a visit, by its exact name.
DATA = dict.fromkeys(("scan.bin", "part.bin", "judged.bin", "reach.bin"), "application/octet-stream")
FILES = (
    {"report.html": "text/html", "report.pdf": "application/pdf", "plan.toml": "application/toml"}
    | dict.fromkeys(("visit.json", "result.json"), "application/json")
    | dict.fromkeys(("start.txt", TRACE), "text/plain")
)
DRAWN = re.compile(r"(map|frame)-\d{1,9}\.bin")
# Bytes of a request that is no file, and how often progress is looked at.
MAX_WORDS_BYTES, POLL_SECONDS = 1 << 20, 0.08


def application(sessions: Sessions, token: str, port: int) -> App:
    """The server as an ASGI application."""
    import starlette.responses  # noqa: F401 - the first answer shall not wait for it
    from starlette.applications import Starlette
    from starlette.routing import Route

    api = Api(sessions)
    routes = [
        Route("/", api.page),
        Route("/page/{name}", api.asset),
        Route("/odometry", api.odometry),
        Route("/odometry/{name}", api.travelled),
        Route("/many", api.many),
        Route("/many/{row}", api.row, methods=["POST"]),
        Route("/visits", api.visits, methods=["GET", "POST"]),
        Route("/visits/{visit}", api.visit),
        Route("/visits/{visit}/change", api.change, methods=["POST"]),
        Route("/visits/{visit}/undo", api.undo, methods=["POST"]),
        Route("/visits/{visit}/cancel", api.cancel, methods=["POST"]),
        Route("/visits/{visit}/events", api.events),
        Route("/visits/{visit}/run/{task}", api.run, methods=["POST"]),
        Route("/visits/{visit}/data/{name}", api.data),
        Route("/visits/{visit}/files/{name}", api.file),
        Route("/visits/{visit}/{side}", api.upload, methods=["PUT"]),
    ]
    return Guard(Starlette(routes=routes, exception_handlers=Troubles(sessions).handlers), token, port)


class Api:
    """Answers to the page."""

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions

    async def page(self, request: Request) -> Response:
        """The page itself."""
        return _asset("index.html")

    async def asset(self, request: Request) -> Response:
        """A file of the page."""
        return _asset(request.path_params["name"])

    async def visits(self, request: Request) -> Response:
        """The visits of this server, or a new one."""
        if request.method == "POST":
            return _told(self._sessions.open())
        sessions = sorted(self._sessions.by_name.values(), key=lambda session: -session.touched)
        return _json([_listed(session) for session in sessions])

    async def odometry(self, request: Request) -> Response:
        """How far the odometry is that the command line named."""
        travel = self._sessions.travel
        return _json(None if travel is None else await asyncio.to_thread(travel.state))

    async def travelled(self, request: Request) -> Response:
        """Map or frame of the odometry, to draw."""
        travel, name = self._sessions.travel, request.path_params["name"]
        known = {name: "application/octet-stream"} if DRAWN.fullmatch(name) else {}
        return _file(Path() if travel is None else travel.folder, name, known if travel else {})

    async def many(self, request: Request) -> Response:
        """The rows of the batch that the command line named."""
        many = self._sessions.many
        return _json(None if many is None else await asyncio.to_thread(many.rows))

    async def row(self, request: Request) -> Response:
        """A row of the batch as a visit of its own."""
        many = self._sessions.many
        if many is None:
            raise InputError("no batch is shown here: start dqreg studio --batch FOLDER")
        return _told(self._sessions.open(await asyncio.to_thread(many.visit, request.path_params["row"])))

    async def visit(self, request: Request) -> Response:
        """A visit as it stands."""
        return _told(self._session(request))

    async def change(self, request: Request) -> Response:
        """Change what was chosen."""
        session, values = self._session(request), await _values(request)
        units = values.pop("units", {})
        text = values.pop("plan", None)
        visit = session.visit.swapped() if values.pop("swap", False) else session.visit.changed(values)
        if isinstance(text, str):
            visit = with_plan(visit, text)
        if not isinstance(units, dict):
            raise InputError("units are those of scan and part, by name")
        for which in ("scan", "part"):
            if which in units:
                visit = visit.with_units(which, units[which])
        session.change(visit)
        return _told(session)

    async def undo(self, request: Request) -> Response:
        """Back to the state before."""
        session = self._session(request)
        session.undo()
        return _told(session)

    async def cancel(self, request: Request) -> Response:
        """End what runs."""
        session = self._session(request)
        await asyncio.to_thread(session.cancel)
        return _told(session)

    async def run(self, request: Request) -> Response:
        """Do a task, and answer with what came of it."""
        task = request.path_params["task"]
        if task not in NAMES:
            raise InputError(f"there is no task {task!r:.40}")
        values = await _values(request)
        return _json(await self._sessions.run(self._session(request), task, values))

    async def upload(self, request: Request) -> Response:
        """Take a file for a side."""
        session, which = self._session(request), request.path_params["side"]
        if which not in ("scan", "part"):
            raise InputError("a file is a scan or a part")
        length = request.headers.get("content-length")
        size = int(length) if length is not None and length.isdecimal() else None
        name = request.query_params.get("name", "")
        side = await uploads.receive(session.folder, which, name, size, request.stream())
        # What was pointed at on another file means nothing on this one.
        before = session.visit
        scan, part = (side, before.part) if which == "scan" else (before.scan, side)
        session.change(Visit(scan, part, head=before.head))
        return _told(session)

    async def events(self, request: Request) -> Response:
        """Stages and iterations as they happen."""
        from starlette.responses import StreamingResponse

        return StreamingResponse(_lines(self._session(request), request), media_type="text/event-stream")

    async def data(self, request: Request) -> Response:
        """Points and triangles to draw."""
        return _file(self._session(request).folder, request.path_params["name"], DATA)

    async def file(self, request: Request) -> Response:
        """A file to keep."""
        session, name = self._session(request), request.path_params["name"]
        keep = request.query_params.get("keep") is not None
        cleaned = {cleaned_name(session.visit) or "": "application/octet-stream"}
        return _file(session.folder, name, FILES | cleaned, keep=keep)

    def _session(self, request: Request) -> Session:
        return self._sessions.find(request.path_params["visit"])


def _told(session: Session) -> Response:
    return _json(
        {
            "name": session.name,
            "visit": plain(session.visit),
            "results": session.results,
            "running": session.running,
            "undo": len(session.past),
            "words": commands_of(session.visit),
            "lost": session.lost,
        }
    )


def _listed(session: Session) -> dict[str, str | None]:
    scan, part = (None if side is None else side.name for side in (session.visit.scan, session.visit.part))
    return {"visit": session.name, "scan": scan, "part": part, "lost": session.lost}


async def _values(request: Request) -> dict[str, Any]:
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_WORDS_BYTES:
            raise InputError(f"a request holds {MAX_WORDS_BYTES} bytes at most")
    try:
        found = json.loads(body or b"{}")
        # Half of a letter can be written in JSON, and in no file.
        json.dumps(found, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise InputError(f"a request is JSON; {error}") from error
    if not isinstance(found, dict):
        raise InputError("a request is one JSON object")
    return found


async def _lines(session: Session, request: Request) -> AsyncIterator[bytes]:
    path, at = session.folder / PROGRESS, 0
    while not await request.is_disconnected():
        with contextlib.suppress(FileNotFoundError):
            size = path.stat().st_size
            at = 0 if size < at else at
            if size > at:
                with path.open("rb") as stream:
                    stream.seek(at)
                    whole, _, _ = stream.read().rpartition(b"\n")
                at += len(whole) + 1 if whole else 0
                for line in whole.splitlines():
                    yield b"data: " + line + b"\n\n"
        await asyncio.sleep(POLL_SECONDS)


def _json(value: Any) -> Response:
    from starlette.responses import JSONResponse

    return JSONResponse(value)


def _asset(name: str) -> Response:
    from starlette.responses import Response

    room = "dqreg.report" if name in SHARED else "dqreg.studio"
    folder = importlib.resources.files(room).joinpath("templates" if name in SHARED else "page")
    known = {each.name for each in folder.iterdir()}
    kind = KINDS.get(Path(name).suffix)
    if name not in known or kind is None:
        return Response("There is no such file.\n", 404, media_type="text/plain")
    return Response(folder.joinpath(name).read_bytes(), media_type=kind)


def _file(folder: Path, name: str, known: dict[str, str], *, keep: bool = False) -> Response:
    from starlette.responses import FileResponse, Response

    path = folder / name
    if name not in known or not path.is_file():
        return Response("There is no such file yet.\n", 404, media_type="text/plain")
    headers = {}
    if known[name] == "text/html":
        headers["content-security-policy"] = REPORT_POLICY
    # The header's escapes are the library's: a name may have quotes and letters of any language.
    how = "attachment" if keep else "inline"
    return FileResponse(path, headers=headers, media_type=known[name], filename=name, content_disposition_type=how)
