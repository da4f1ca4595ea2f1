"""Many connections, viewers and odd requests at once: a STOP and the owner of the token always get through."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import ExitStack, suppress
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import uvicorn
from starlette.testclient import TestClient
from uvicorn.server import ServerState

from gcs_autotune.errors import UsageError
from gcs_autotune.web import Access, crowd, make_app
from gcs_autotune.web import archive as archive_module
from gcs_autotune.web import live as live_module
from gcs_autotune.web.access import ALL_AT_ONCE, AT_ONCE, TOKEN_HEADER
from gcs_autotune.web.archive import Archive
from gcs_autotune.web.crowd import OF_ONE_ADDRESS, WAITING, Seldom, WaitingRoom
from gcs_autotune.web.live import MOST_VIEWERS, Live

from .serving import ROOT

posix = pytest.mark.skipif(os.name != "posix", reason="sockets are counted as POSIX has them")
HALF_OPEN = 1200


@posix
def test_a_stop_works_with_1200_half_open_connections_which_are_closed_without_logging(tmp_path: Path) -> None:
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    words = [sys.executable, "-m", "tests.web.serving", str(tmp_path), "scripted", "127.0.0.1"]
    limited = ["sh", "-c", 'ulimit -S -n 1024; exec "$@"', "sh", *words]
    with ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        server = stack.enter_context(
            subprocess.Popen(limited, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        )
        stack.callback(server.terminate)
        assert server.stdout is not None
        port = int(server.stdout.readline().split("/")[2].rpartition(":")[2])
        many = []
        for k in range(HALF_OPEN):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=20.0))
            one.sendall(b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\n" if k % 2 else b"")
            many.append(one)
        begun = time.monotonic()
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
        connection.request("POST", "/stop", headers={TOKEN_HEADER: "none"})
        assert json.loads(connection.getresponse().read()) == {"stopping": False}
        assert time.monotonic() - begun < 2.0
        connection.close()
        with suppress(ConnectionResetError):
            assert many[0].recv(1000) == b""
        server.terminate()
        assert server.stdout.read().count("\n") < 20


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"])
def test_a_connection_without_a_complete_request_is_closed_after_a_timeout(
    sent: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crowd, "HEADERS_WITHIN", 0.05)

    async def scene() -> bytes:
        config = uvicorn.Config(make_app(tmp_path, Access()), http=crowd.guarded(), log_level="critical")
        config.load()
        protocol, state = crowd.guarded(), ServerState()
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: protocol(config, state, {}), "127.0.0.1", 0)
        async with server:
            reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
            writer.write(sent)
            came = b""
            with suppress(ConnectionResetError):
                came = await asyncio.wait_for(reader.read(), 10.0)
            writer.close()
            with suppress(ConnectionResetError):
                await writer.wait_closed()
        return came

    assert asyncio.run(scene()) == b""


def test_waiting_connections_are_limited_per_address_and_in_total() -> None:
    room, gone = WaitingRoom(), []
    for k in range(OF_ONE_ADDRESS + 10):
        room.enter(("one", k), "one", lambda k=k: gone.append(k))
    assert gone == list(range(10))
    for k in range(300):
        room.enter(("many", k), f"address {k}", lambda k=k: gone.append(-k))
    assert len(room) == WAITING
    assert gone[10:12] == [10, 11]


def test_a_repeated_log_line_is_limited_to_a_few_per_minute() -> None:
    now = [0.0]
    seldom = Seldom(lambda: now[0])
    record: Any = SimpleNamespace(msg="socket.accept() out of system resource")
    assert sum(seldom.filter(record) for _ in range(13_905)) == 3
    assert seldom.filter(SimpleNamespace(msg="another"))  # type: ignore[arg-type]
    now[0] = 61.0
    assert seldom.filter(record)


async def first_of(viewer: AsyncIterator[str]) -> str:
    return await anext(viewer)


def test_a_viewer_with_the_token_replaces_one_without() -> None:
    async def scene() -> None:
        live = Live()
        guests = [live.watch() for _ in range(MOST_VIEWERS)]
        for guest in guests:
            await first_of(guest)
        assert [text async for text in live.watch()] == []
        owner = live.watch(owner=True)
        assert "whole" in await first_of(owner)
        assert [text async for text in guests[0]] == []
        assert [text async for text in live.watch()] == []

    asyncio.run(scene())


def test_the_token_grants_a_seat_even_with_40_viewers_without_it(tmp_path: Path) -> None:
    access = Access("right")
    with TestClient(make_app(tmp_path, access), base_url="http://127.0.0.1:8090") as client, ExitStack() as stack:
        for _ in range(40):
            socket = stack.enter_context(client.websocket_connect("ws://127.0.0.1:8090/live"))
            socket.receive()
        document = client.post("/token", headers={TOKEN_HEADER: "right"}).json()
        owner = stack.enter_context(client.websocket_connect(f"ws://127.0.0.1:8090/live?seat={document['seat']}"))
        assert "whole" in owner.receive_text()
    assert not access.may_sit("")
    assert not Access().may_sit("")


def test_requests_without_the_token_are_limited_and_a_stop_is_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_module, "MOST_VIEWERS", 1000)
    app = make_app(tmp_path, Access("right"))

    async def scene() -> list[int]:
        held = asyncio.Event()
        statuses: list[int] = []

        async def ask(path: str, method: str, address: str, **headers: str) -> None:
            scope = {
                "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "path": path,
                "raw_path": path.encode(), "query_string": b"", "root_path": "", "scheme": "http",
                "headers": [(b"host", b"127.0.0.1:8090"), *((k.encode(), v.encode()) for k, v in headers.items())],
                "client": (address, 1), "server": ("127.0.0.1", 8090),
            }  # fmt: skip

            async def receive() -> dict[str, Any]:
                await held.wait()
                return {"type": "http.disconnect"}

            async def send(message: dict[str, Any]) -> None:
                if message["type"] == "http.response.start":
                    statuses.append(message["status"])

            await app(scope, receive, send)

        async with app.router.lifespan_context(app):
            viewers = [asyncio.create_task(ask("/events", "GET", "one")) for _ in range(AT_ONCE + 5)]
            await asyncio.sleep(0.05)
            for k in range(ALL_AT_ONCE):
                viewers.append(asyncio.create_task(ask("/events", "GET", f"address {k}")))
            await asyncio.sleep(0.05)
            assert statuses.count(503) == 5 + AT_ONCE
            assert statuses.count(200) == ALL_AT_ONCE
            await ask("/stop", "POST", "one", **{TOKEN_HEADER: "right"})
            held.set()
            await asyncio.gather(*viewers)
        return statuses

    assert asyncio.run(scene())[-1] == 200


@pytest.mark.parametrize(
    "body",
    [
        b'{"id": 1e999, "yes": true}',
        b'{"id": 1' + b"0" * 400 + b', "yes": true}',
        b'{"id": NaN, "yes": true}',
        b'{"id": "1", "yes": true}',
        b'{"id": true, "yes": 1}',
        b"[" * 60_000,
        b'{"a":' * 10_000,
        b'{"id": 1, "id": 2, "yes": true}',
        b'{"job": "\\ud800", "axis": "\\udfff", "connect": "\\ud800"}',
        b'{"job": "tune", "axis": "heading", "numbers": {"step": "1_0"}}',
        b'{"job": "tune", "axis": "heading", "numbers": {"step": {}}}',
        b'{"job": "tune", "axis": "heading", "numbers": [1]}',
        b'{"job": {}, "axis": []}',
        b'{"name": "\\ud800", "verb": "list"}',
        b'{"name": 1e400, "verb": []}',
        b"\xff\xfe",
        b'{"job": "fly", "manoeuvre": "zig-zag", "area": "59,10 60,11 59,11 60,10"}',
    ],
)
def test_malformed_requests_are_rejected_with_a_message(tmp_path: Path, body: bytes) -> None:
    app = make_app(tmp_path, Access())
    with TestClient(app, base_url="http://127.0.0.1:8090") as client:
        for where in ("/start", "/answer", "/work"):
            answer = client.post(where, content=body, headers={TOKEN_HEADER: "none"})
            assert 400 <= answer.status_code < 500
            assert answer.json()["error"]


@pytest.mark.parametrize("origin", ["http://[bad", "http://[::1", "//", "null", "\x00", "http://évil"])
def test_an_invalid_origin_is_rejected(tmp_path: Path, origin: str) -> None:
    with TestClient(make_app(tmp_path, Access()), base_url="http://127.0.0.1:8090") as client:
        headers = {TOKEN_HEADER: "none", "Origin": origin.encode()}
        assert client.post("/stop", headers=headers).status_code == 403  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "side",
    [
        "[]",
        "1",
        "[" * 50_000,
        '{"meta": [], "marks": 3, "name": {}}',
        '{"meta": {"reference": NaN, "signal": []}}',
        '{"meta": {"reference": 1e999}}',
        '{"name": "\\ud800"}',
        '{"marks": [{"kind": "target", "t": "x", "detail": []}]}',
        '{"marks": [null]}',
    ],
)
def test_a_run_with_an_invalid_side_file_can_be_viewed(tmp_path: Path, side: str) -> None:
    trials = tmp_path / "20261126-boat" / "trials"
    trials.mkdir(parents=True)
    (trials / "1-relay.csv").write_text("t[s],psi[rad]\n0,0\n")
    (trials / "1-relay.json").write_text(side)
    (trials.parent / "summary.json").write_text(side)
    (trials.parent / os.fsdecode(b"bad-\xff.txt")).write_text("x")
    with TestClient(make_app(tmp_path, Access()), base_url="http://127.0.0.1:8090") as client:
        assert client.get("/runs").status_code == 200
        answer = client.get("/runs/20261126-boat")
        assert answer.status_code == 200
        assert answer.json()["trials"][0]["name"] == "1-relay"


def test_an_upload_of_unknown_size_ends_at_the_disk_reserve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = [archive_module._SPARE + 10_000]

    async def pieces() -> AsyncIterator[bytes]:
        for _ in range(1000):
            yield b"x" * 1000
            free[0] -= 1000

    monkeypatch.setattr(archive_module.shutil, "disk_usage", lambda path: SimpleNamespace(free=free[0]))
    with pytest.raises(UsageError, match="nearly full"):
        asyncio.run(Archive(tmp_path).take_in("a.csv", None, pieces(), datetime(2026, 1, 1)))
    assert free[0] >= archive_module._SPARE
    assert list(tmp_path.iterdir()) == []


def test_wrong_tokens_are_counted_per_address_not_per_connection(tmp_path: Path) -> None:
    access = Access("right")
    app = make_app(tmp_path, access)
    statuses = []
    for port in range(12):
        with TestClient(app, base_url="http://127.0.0.1:8090", client=("10.0.0.1", 40_000 + port)) as client:
            statuses.append(client.post("/token", headers={TOKEN_HEADER: "wrong"}).status_code)
    assert statuses == [403] * 10 + [429] * 2
