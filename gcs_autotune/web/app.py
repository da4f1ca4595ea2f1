"""The routes of the page. Every address in it is relative, so that it can be served under another path."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import asynccontextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from msgspec import Struct
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from gcs_autotune import __version__
from gcs_autotune.errors import UsageError
from gcs_autotune.plain_json import json_text
from gcs_autotune.web.access import Access, AccessMiddleware
from gcs_autotune.web.archive import ORDERED, Archive
from gcs_autotune.web.blueos import blueos_routes
from gcs_autotune.web.desk import DOFS, Desk, archive_routes
from gcs_autotune.web.job import CommandLine, Job
from gcs_autotune.web.live import Live
from gcs_autotune.web.orders import fields, make_order
from gcs_autotune_files import conform, parse

__all__ = ["Control", "make_app"]

STATIC = Path(__file__).parent / "static"
FILES = {
    "page.css": "text/css",
    "uPlot.min.css": "text/css",
    "uPlot.iife.min.js": "text/javascript",
    "main.js": "text/javascript",
    "state.js": "text/javascript",
    "charts.js": "text/javascript",
    "start.js": "text/javascript",
    "runs.js": "text/javascript",
    "result.js": "text/javascript",
    "whatif.js": "text/javascript",
    "uPlot-LICENSE.txt": "text/plain",
    "icon.svg": "image/svg+xml",
}
"""Names of the page's files in addition to ``index.html``."""
_LONGEST_BODY = 1 << 16
BODY_WITHIN = 10.0
"""Time [s] within which the body of a request must arrive. Project choice."""

Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class Control:
    """Controls the current run, if any, and its state."""

    def __init__(self, runs: Path, program: CommandLine, preset: Mapping[str, Any]) -> None:
        self.preset = preset
        self.runs = runs
        self.program = program
        self.live = Live()
        self.archive = Archive(runs)
        self.desk = Desk(self.archive, program, self.live)
        self._job: Job | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def is_running(self) -> bool:
        """Whether a run is in progress."""
        return self._task is not None and not self._task.done()

    def start(self, chosen: dict[str, Any], now: datetime) -> str:
        """Start the run that was *chosen* and return the name of its run directory.

        Raises ``UsageError`` if it cannot be started.
        """
        order = make_order(chosen, self.runs, now)
        self.desk.give_way()
        self.live.begin(
            {
                "title": order.title,
                "command": order.command,
                "name": order.directory.name,
                "simulated": order.is_simulated,
                "begun": now.isoformat(),
            }
        )
        self._job = Job(self.program, order.arguments, order.directory, self.live, is_undo=order.is_undo)
        self._task = asyncio.create_task(self._run(self._job))
        if not (order.is_undo or chosen.get("resume")):
            self._task.add_done_callback(lambda _: self._keep(order.directory, chosen))
        return order.directory.name

    @staticmethod
    def _keep(directory: Path, chosen: dict[str, Any]) -> None:
        """Store what was *chosen* in the directory of the run, to start it again with the same settings."""
        with suppress(OSError):  # the disk is full; the run itself has reported that
            (directory / ORDERED).write_text(json_text(chosen), encoding="utf-8") if directory.is_dir() else None

    async def _run(self, job: Job) -> None:
        try:
            await job.run()
        except OSError as error:
            self.live.put(
                "end",
                {
                    "code": 1,
                    "meaning": "the run could not be started",
                    "reason": str(error),
                    "fine": True,
                    "put_back": ["Nothing was armed, moved or written."],
                },
            )

    def stop(self) -> bool:
        """Request a stop of the run with clean-up. Return whether there is a run."""
        if self._job is None or not self.is_running:
            return False
        self._job.stop()
        return True

    def answer(self, number: int, *, yes: bool) -> bool:
        """Answer question *number* of the run. Return whether the answer counts."""
        return self._job is not None and self._job.answer(number, yes=yes)

    async def over(self) -> None:
        """Wait until no run is in progress."""
        if self._task is not None:
            with suppress(asyncio.CancelledError):
                await asyncio.shield(self._task)


def make_app(
    runs: Path, access: Access, program: CommandLine | None = None, preset: Mapping[str, Any] | None = None
) -> Starlette:
    """Return the ASGI application of the page. Runs are stored in *runs* and started by *program*.

    preset : option -> value of the settings file.
    """
    control = Control(runs, program or CommandLine(), preset or {})

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        telling = asyncio.create_task(control.live.run())
        try:
            yield
        finally:
            control.stop()
            await control.over()
            await control.desk.over()
            telling.cancel()

    looking, (drop, work) = archive_routes(control.archive, control.desk, lambda: control.is_running)
    app = Starlette(
        routes=[
            *_page(),
            *blueos_routes(access, control.stop),
            *_looking(control, access),
            *looking,
            *_touching(control, access, drop, work),
        ],
        middleware=[Middleware(AccessMiddleware, access=access)],
        lifespan=lifespan,
    )
    app.state.control = control
    return app


def _page() -> list[BaseRoute]:
    async def index(request: Request) -> Response:
        return FileResponse(STATIC / "index.html", media_type="text/html")

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in FILES:
            return JSONResponse({"error": "this file does not exist. Reload the page"}, 404)
        return FileResponse(STATIC / name, media_type=FILES[name])

    return [Route("/", index), Route("/static/{name}", static)]


def _looking(control: Control, access: Access) -> list[BaseRoute]:
    async def about(request: Request) -> Response:
        return JSONResponse(
            {"version": __version__, "token_needed": bool(access.token), "dofs": DOFS, **fields(control.preset)}
        )

    async def live(socket: WebSocket) -> None:
        await socket.accept()
        owner = access.may_sit(socket.query_params.get("seat", ""))
        sending = asyncio.create_task(_send_all(socket, control.live, owner=owner))
        with suppress(WebSocketDisconnect, RuntimeError):
            # a viewer sends nothing; this detects that it has left
            while (await socket.receive())["type"] != "websocket.disconnect":
                pass
        sending.cancel()

    async def events(request: Request) -> Response:
        owner = access.may_sit(request.query_params.get("seat", ""))

        async def lines() -> AsyncIterator[str]:
            async for text in control.live.watch(owner=owner):
                yield f"data: {text}\n\n"

        return StreamingResponse(lines(), media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})

    return [Route("/about", about), WebSocketRoute("/live", live), Route("/events", events)]


async def _send_all(socket: WebSocket, live: Live, *, owner: bool) -> None:
    with suppress(WebSocketDisconnect, RuntimeError, OSError):
        async for text in live.watch(owner=owner):
            await socket.send_text(text)
        await socket.close(1013)


def _touching(
    control: Control, access: Access, drop: Handler, do: Callable[[dict[str, Any]], Response]
) -> list[BaseRoute]:
    async def token(request: Request) -> Response:
        return JSONResponse({"ok": True, "seat": access.seat})  # the middleware has seen it

    async def stop(request: Request) -> Response:
        return JSONResponse({"stopping": control.stop()})

    async def answer(request: Request) -> Response:
        told = await _body(request)
        answered = conform(told, _Answer)
        counted = control.answer(answered.id, yes=answered.yes)
        return JSONResponse({"counted": counted})

    async def start(request: Request) -> Response:
        chosen = await _body(request)
        if control.is_running:
            return JSONResponse({"error": "a run is in progress. Stop it, or wait until it ends"}, 409)
        return JSONResponse({"name": control.start(chosen, datetime.now())})

    async def work(request: Request) -> Response:
        return do(await _body(request))

    handlers = (token, stop, answer, start, drop, work)
    return [Route(f"/{each.__name__}", _answered(each), methods=["POST"]) for each in handlers]


def _answered(handler: Handler) -> Handler:
    """Return *handler* with the errors of a request converted to messages."""

    async def answering(request: Request) -> Response:
        try:
            return await handler(request)
        except UsageError as error:
            return JSONResponse({"error": str(error)}, 400)
        except TimeoutError:
            return JSONResponse({"error": "the request arrived incomplete. Try again"}, 408)
        except (ValueError, KeyError, TypeError, ArithmeticError):
            return JSONResponse({"error": "the server cannot read this request. Reload the page"}, 400)

    return answering


async def _body(request: Request) -> dict[str, Any]:
    """Return the JSON object in a request (``ValueError`` for anything else)."""
    body = b""
    async with asyncio.timeout(BODY_WITHIN):
        async for piece in request.stream():
            body += piece
            if len(body) > _LONGEST_BODY:
                raise ValueError("too long")
    told = parse(body)
    if not isinstance(told, dict):
        raise TypeError("no object")
    return told


class _Answer(Struct):
    """The operator's answer to question *id*."""

    id: int
    yes: bool
