"""The port, the link with the token, and the shutdown: a run is stopped and restored before the server exits."""

from __future__ import annotations

import logging
import socket
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import segno
import uvicorn

from gcs_autotune.errors import CannotOpenLink, UsageError
from gcs_autotune.observer import stopping
from gcs_autotune.web.access import Access, is_loopback
from gcs_autotune.web.app import Control, make_app
from gcs_autotune.web.crowd import Seldom, guarded
from gcs_autotune.web.job import CommandLine

__all__ = ["ServeSettings", "serve"]


BACKLOG = 100
"""Largest number of connections accepted in one turn of the event loop, before any of them is counted or closed.
Project choice.

With uvicorn's 2048, many connections at once would use up all file descriptors in a single turn.
"""


QUEUE = 2048
"""Largest number of connections that the system queues until they are accepted. Beyond it, a caller retries after a
second. Project choice.
"""


@dataclass(frozen=True, slots=True)
class ServeSettings:
    """Where the page is served: *host* and *port* to listen on, the folder of *runs*, and other names of the server.

    ``joystick_stop``: whether Cockpit is offered a STOP for a joystick button. ``preset``: option -> value
    of the settings file; ``craft``: those of each craft by name.
    """

    host: str
    port: int
    runs: Path
    allowed: tuple[str, ...] = ()
    joystick_stop: bool = False
    preset: Mapping[str, Any] = field(default_factory=dict)


def serve(settings: ServeSettings, say: Callable[[str], object], program: CommandLine | None = None) -> None:
    """Serve the page until Ctrl-C. A current run is stopped and restored first.

    Raises
    ------
    CannotOpenLink
        The port cannot be opened.
    UsageError
        The folder of runs cannot be created.
    """
    try:
        settings.runs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"the folder of runs {settings.runs} cannot be created: {error}. Use another --runs"
        ) from error
    open_socket = _listen(settings.host, settings.port)
    port = open_socket.getsockname()[1]
    alone = is_loopback(settings.host)
    stop_key = Access.new_token() if settings.joystick_stop else ""
    access = Access("" if alone else Access.new_token(), settings.allowed, stop_key=stop_key)
    app = make_app(settings.runs.absolute(), access, program, settings.preset)
    for line in told(settings.host, port, access.token):
        say(line)
    for name in ("uvicorn.error", "asyncio"):
        logging.getLogger(name).addFilter(Seldom())
    config = uvicorn.Config(
        app,
        http=guarded(),
        backlog=BACKLOG,
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_per_message_deflate=False,
        ws_max_size=4096,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=2,
    )
    with open_socket:
        _Server(config, app.state.control, say).run([open_socket])
    say("page closed")


class _Server(uvicorn.Server):
    """A server that keeps running after Ctrl-C until the current run has restored everything."""

    def __init__(self, config: uvicorn.Config, control: Control, say: Callable[[str], object]) -> None:
        super().__init__(config)
        self._control = control
        self._say = say
        self._wanted = False

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop the run. Further signals only report that the clean-up is in progress; it is never interrupted."""
        if not self._control.is_running:
            self.should_exit = True  # uvicorn's own way raises the signal again once all is closed
            return
        self._say(stopping(again=self._wanted))
        self._wanted = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to accept connections. The system queues more connections than are accepted in one turn."""
        await super().startup(sockets)
        for each in sockets or ():
            each.listen(QUEUE)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Shut down, with the viewers' streams closed first, because an open stream would delay the end and log
        an error.
        """
        self._control.live.close()
        await super().shutdown(sockets)

    async def on_tick(self, counter: int) -> bool:
        """Exit if requested and no run is in progress. It is called ten times a second."""
        if self._wanted:
            self.should_exit = not self._control.stop()
        return await super().on_tick(counter)


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        opened = socket.socket(family, kind)
    except OSError as error:
        raise CannotOpenLink(f"cannot listen on {host}: {error}. Use another --host") from error
    try:
        if sys.platform != "win32":
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(address)
        opened.listen(128)
    except OSError as error:
        opened.close()
        raise CannotOpenLink(
            f"cannot listen on {host} port {port}: {error.strerror or error}. Stop the other server, or use another "
            f"--port"
        ) from error
    return opened


def told(host: str, port: int, token: str) -> list[str]:
    """Return the text for the terminal: the link, and if a token is needed, with the token and as QR code."""
    if not token:
        return [f"page: http://{_bracketed(host)}:{port}/  (this computer only; Ctrl-C ends the server)"]
    link = f"http://{_bracketed(_seen_from_elsewhere(host))}:{port}/#{token}"
    code = segno.make(link, micro=False)
    dots = "\n".join(_blocks([list(row) for row in code.matrix_iter(border=2)]))
    return [
        f"page: {link}",
        dots,
        "Everyone with this link can start and stop runs. It is shown once. Without the part after # the page is view "
        "only. The connection is not encrypted: use a network you trust. Ctrl-C ends the server.",
    ]


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _seen_from_elsewhere(host: str) -> str:
    """Return the address to connect to if *host* means all addresses."""
    if host not in ("0.0.0.0", "::", ""):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # a documentation address: nothing is sent, only a route looked up
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def _blocks(rows: list[list[int]]) -> list[str]:
    """Return a QR code as text in half blocks, light on dark: two rows of modules per line."""
    if len(rows) % 2:
        rows = [*rows, [0] * len(rows[0])]
    shapes = {(0, 0): "█", (0, 1): "▀", (1, 0): "▄", (1, 1): " "}
    pairs = zip(rows[::2], rows[1::2], strict=True)
    return ["".join(shapes[int(bool(a)), int(bool(b))] for a, b in zip(*pair, strict=True)) for pair in pairs]
