"""Work on records from the page: list, identify and diagnose, each by our command line in a separate process."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.background import BackgroundTask
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from gcs_autotune.errors import UsageError
from gcs_autotune.registry import lookup
from gcs_autotune.untrusted_text import visible
from gcs_autotune.web.archive import KINDS, STYLED, Archive, loop_of, packed
from gcs_autotune.web.job import CommandLine
from gcs_autotune.web.live import Live
from gcs_autotune_files import whole

__all__ = ["DOFS", "Desk", "archive_routes"]

DOFS = ("yaw", "surge", "sway", "heave", "horizontal")
PORTS = "ports"
"""Command that listens for vehicles, of no record."""
LONGEST = 1800.0
"""Longest duration of a calculation [s]. Project choice."""
PIECE_WITHIN = 30.0
"""Time [s] within which the next piece of a dropped file must arrive. Project choice."""
_TEXT = 40_000
"""Number of characters of the printed output that are kept. Project choice."""
VERBS: Mapping[str, Callable[[Path, Path, str, Path], list[str]]] = {
    "list": lambda folder, file, dof, other: ["logs", "list", str(file)],
    "identify": lambda folder, file, dof, other: [
        "identify",
        str(file),
        f"--dof={dof}",
        f"--page={folder / f'identified-{dof}.html'}",
        f"--save={folder / f'model-{dof}.json'}",
    ],
    "diagnose": lambda folder, file, dof, other: [
        "diagnose",
        str(file),
        f"--dof={dof}",
        f"--out={folder / 'diagnosis'}",
    ],
    "what-if": lambda folder, file, dof, other: [
        "design",
        str(folder),
        f"--for={loop_of(folder)}",
        f"--styles={folder / STYLED}",
    ],
    "compare": lambda folder, file, dof, other: [
        "compare",
        str(file),
        str(other),
        f"--page={folder / 'comparison.html'}",
    ],
}
"""Operation on a record -> our command line for it, also with the record of another run."""
MOST_PAGE = 16 * 1024 * 1024
"""Size [bytes] of a page from which it is sent unchanged. Project choice."""
REPORTS = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'; "
    "sandbox allow-scripts allow-downloads; script-src "
)
"""Content security policy of the pages in the folder of runs, except the permitted script: any style is allowed."""


def _script_of(kind: str) -> str:
    """Return the script that a file of content type *kind* may run."""
    if kind != "text/html":
        return "'none'"
    from gcs_autotune.report import script_digest  # imported with the first report: it takes a second

    return script_digest()


def _with_zip(page: str, request: Request) -> str:
    """Return the text of a report with a link to its whole run as a zip, before the foot of the page."""
    up = "../" * (2 + request.path_params["inner"].count("/"))
    link = f'<p><a href="{up}zip/{quote(request.path_params["name"])}">Download the whole run (zip)</a></p>'
    before, foot, after = page.rpartition("<footer>")
    return before + link + foot + after if foot else page


class Desk:
    """Runs one calculation at a time; a run has priority."""

    def __init__(self, archive: Archive, program: CommandLine, live: Live) -> None:
        self._archive = archive
        self._program = program
        self._live = live
        self._task: asyncio.Task[None] | None = None

    def start(self, name: str, verb: str, dof: str, other: str = "") -> None:
        """Start a calculation in a separate process. Raises ``UsageError`` if this is not possible.

        other : name of the run to compare with.
        """
        lookup(VERBS, verb, "work")
        if dof not in DOFS:
            raise UsageError(f"unknown degree of freedom. Use one of {', '.join(DOFS)}")
        if self._task is not None and not self._task.done():
            raise UsageError("another job is running. Wait until it ends")
        entry, folder = self._archive.entry(name), self._archive.path(name)
        file = self._record(name)
        if verb == "list" and not entry["log"]:
            file = self._archive.path(name, "telemetry.tlog")
        if verb == "what-if" and not entry["loop"]:
            raise UsageError("this run has no model of a loop that can be designed")
        arguments = VERBS[verb](folder, file, dof, self._record(other) if verb == "compare" else folder)
        self._tell(name, verb, "", running=True)
        self._task = asyncio.create_task(self._run(name, verb, arguments, folder))

    def listen(self) -> None:
        """Start to listen for vehicles on the ports. Nothing is sent. Raises ``UsageError`` if this is not possible."""
        if self._task is not None and not self._task.done():
            raise UsageError("another job is running. Wait until it ends")
        self._tell("", PORTS, "", running=True)
        self._task = asyncio.create_task(self._run("", PORTS, [PORTS, "--json"], self._archive.root))

    def _record(self, name: str) -> Path:
        """Return the dropped log of an entry, or else the run directory."""
        log, folder = self._archive.entry(name)["log"], self._archive.path(name)
        return folder / log if log else folder

    def _tell(self, name: str, verb: str, text: str, *, running: bool, code: int | None = None) -> None:
        told = {"name": name, "verb": verb, "running": running, "text": visible(text, keep="\n"), "code": code}
        self._live.put("desk", told)

    async def _run(self, name: str, verb: str, arguments: list[str], folder: Path) -> None:
        process = await asyncio.create_subprocess_exec(
            *self._program.words,
            *arguments,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**self._program.environment, "COLUMNS": "100", "NO_COLOR": "1"},
            cwd=folder,
            start_new_session=True,
        )
        text = ""
        try:
            async with asyncio.timeout(LONGEST):
                assert process.stdout is not None
                while piece := await process.stdout.read(8192):
                    text = (text + piece.decode(errors="replace"))[-_TEXT:]
                code = await process.wait()
        except TimeoutError:
            code, text = -1, text + f"\nstopped: the time limit of {LONGEST:.0f} s was reached"
        except asyncio.CancelledError:
            code, text = -1, text + "\nstopped: a run was started and has priority"
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
        self._tell(name, verb, text, running=False, code=code)

    def give_way(self) -> None:
        """End the present calculation, because a run begins."""
        if self._task is not None:
            self._task.cancel()

    async def over(self) -> None:
        """End the present calculation and wait until it has ended."""
        self.give_way()
        if self._task is not None:
            with suppress(asyncio.CancelledError):
                await self._task


def archive_routes(archive: Archive, desk: Desk, is_running: Callable[[], bool]) -> tuple[list[BaseRoute], Any]:
    """Return the routes that read the archive, and the two handlers that change something: ``drop`` and ``work``."""

    def runs(request: Request) -> Response:  # plain functions: the files are read in a thread
        return JSONResponse({"entries": archive.entries()})

    def run(request: Request) -> Response:
        try:
            return JSONResponse(archive.entry(request.path_params["name"]))
        except UsageError as error:
            return JSONResponse({"error": str(error)}, 404)

    def file(request: Request) -> Response:
        try:
            path = archive.path(request.path_params["name"], request.path_params["inner"])
        except UsageError as error:
            return JSONResponse({"error": str(error)}, 404)
        kind = KINDS.get(path.suffix.lower())
        if kind is None:
            return JSONResponse({"error": "files of this type are not available"}, 404)
        headers = {"Content-Security-Policy": REPORTS + _script_of(kind)}
        if kind == "text/html" and path.stat().st_size < MOST_PAGE:
            return HTMLResponse(_with_zip(path.read_text("utf-8", "replace"), request), headers=headers)
        if kind == "application/octet-stream":
            return FileResponse(path, media_type=kind, headers=headers, filename=path.name)
        return FileResponse(path, media_type=kind, headers=headers)

    def download(request: Request) -> Response:
        name = request.path_params["name"]
        try:
            whole = packed(archive.path(name))
        except UsageError as error:
            return JSONResponse({"error": str(error)}, 404)
        headers = {"Content-Disposition": f'attachment; filename="{name}.zip"'}
        pieces = iter(lambda: whole.read(1 << 16), b"")
        return StreamingResponse(
            pieces, media_type="application/zip", headers=headers, background=BackgroundTask(whole.close)
        )

    async def drop(request: Request) -> Response:
        announced = request.headers.get("content-length", "")
        name = request.query_params.get("name", "")

        async def pieces() -> AsyncIterator[bytes]:
            stream = aiter(request.stream())
            while True:
                async with asyncio.timeout(PIECE_WITHIN):
                    try:
                        piece = await anext(stream)
                    except StopAsyncIteration:
                        return
                yield piece

        size = whole(announced, 2**62) if announced else None
        kept = await archive.take_in(name, size, pieces(), datetime.now())
        return JSONResponse({"name": kept})

    def work(told: Mapping[str, Any]) -> Response:
        if is_running():
            return JSONResponse({"error": "a run is in progress and has priority. Wait until it ends"}, 409)
        if told["verb"] == PORTS:
            desk.listen()
            return JSONResponse({"ok": True})
        desk.start(str(told["name"]), str(told["verb"]), str(told.get("dof", "yaw")), str(told.get("other", "")))
        return JSONResponse({"ok": True})

    looking: list[BaseRoute] = [Route("/runs", runs), Route("/runs/{name}", run)]
    looking.append(Route("/zip/{name}", download))
    looking.append(Route("/files/{name}/{inner:path}", file))
    return looking, (drop, work)
