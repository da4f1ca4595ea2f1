"""Files on disk: listed, served and accepted; nothing outside the folder of runs."""

from __future__ import annotations

import asyncio
import json
import re
import sys
from collections.abc import AsyncIterator, Iterator
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urljoin

import pytest
from starlette.testclient import TestClient

from gcs_autotune.errors import UsageError
from gcs_autotune.report import script_digest
from gcs_autotune.web import Access, CommandLine, make_app
from gcs_autotune.web import archive as archive_module
from gcs_autotune.web.access import TOKEN_HEADER
from gcs_autotune.web.archive import Archive

OURS = {TOKEN_HEADER: "none"}
ECHO = CommandLine((sys.executable, "-c", "import sys; print('did', *sys.argv[1:]); print('\\x1b[2J<b>')"))
TABLE = b"t[s],psi[rad],r[rad/s],N[1]\n0,0,0,0\n0.1,0.01,0.1,0.5\n"


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    trials = folder / "20260101-run" / "trials"
    trials.mkdir(parents=True)
    (tmp_path / "secret.txt").write_text("not yours")
    (trials / "01-step.csv").write_bytes(TABLE)
    marks = [{"t": 0.1, "kind": "target", "detail": {"value": 0.5}}, {"t": 0.2, "kind": "switch", "detail": {}}]
    values = {"name": "step", "ending": "completed", "reason": "flown", "meta": {"signal": "psi"}, "marks": marks}
    (trials / "01-step.json").write_text(json.dumps(values))
    (folder / "20260101-run" / "report.html").write_text("<script>alert(1)</script>")
    (folder / "20260101-run" / "summary.json").write_text(json.dumps({"title": "tune heading", "ending": "kept"}))
    (folder / "20260101-run" / "telemetry.tlog").write_bytes(b"\xfe")
    (folder / "20260101-run" / "odd.exe").write_bytes(b"MZ")
    (folder / "20260101-run" / "way.txt").symlink_to(tmp_path / "secret.txt")
    (folder / "elsewhere").symlink_to(tmp_path)
    return folder


@pytest.fixture
def client(runs: Path) -> Iterator[TestClient]:
    with TestClient(make_app(runs, Access(), ECHO), base_url="http://127.0.0.1:8090") as one:
        yield one


def test_runs_are_listed_with_what_can_be_replayed(client: TestClient) -> None:
    (entry,) = [e for e in client.get("/runs").json()["entries"] if e["name"] == "20260101-run"]
    assert (entry["title"], entry["ending"], entry["report"], entry["log"]) == (
        "tune heading",
        "kept",
        "report.html",
        "",
    )
    document = client.get("/runs/20260101-run").json()
    assert [t["name"] for t in document["trials"]] == ["step"]
    assert document["trials"][0]["targets"] == [[0.1, 0.5]]
    assert "trials/01-step.csv" in document["files"]
    assert client.get("/files/20260101-run/trials/01-step.csv").content == TABLE


def test_a_report_may_run_only_the_script_of_its_charts(client: TestClient) -> None:
    answer = client.get("/files/20260101-run/report.html")
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    assert "allow-same-origin" not in policy
    assert policy.endswith(f"; script-src {script_digest()}")


def test_a_served_report_links_to_the_zip_of_its_run(client: TestClient, runs: Path) -> None:
    file = runs / "20260101-run" / "report.html"
    for page in (file, runs / "20260101-run" / "trials" / "more.html"):
        page.write_text("<main>a<footer>b</footer></main>")
        where = f"/files/{page.relative_to(runs).as_posix()}"
        output = client.get(where).text
        (link,) = re.findall(r'<main>a<p><a href="([^"]*)">Download the whole run \(zip\)</a></p><footer>', output)
        assert client.get(urljoin(where, link)).headers["content-type"] == "application/zip"
    assert "zip" not in file.read_text()


@pytest.mark.parametrize(
    "where",
    [
        "/files/20260101-run/way.txt",
        "/files/20260101-run/odd.exe",
        "/files/20260101-run/..%2F..%2Fsecret.txt",
        "/files/20260101-run/%2e%2e/%2e%2e/secret.txt",
        "/files/..%2F/secret.txt",
        "/files/%2e%2e/secret.txt",
        "/files/elsewhere/secret.txt",
        "/files/20260101-run//etc/passwd",
        "/files/20260101-run/%00",
        "/files/20260101-run/",
        "/runs/elsewhere",
        "/runs/..",
        "/runs/%2e%2e",
        "/runs/none",
    ],
)
def test_no_path_leaves_the_folder_of_runs(client: TestClient, where: str) -> None:
    answer = client.get(where)
    assert answer.status_code in (404, 200)  # `..` may be resolved to the page itself
    assert b"not yours" not in answer.content
    assert b"root:" not in answer.content
    assert answer.status_code == 404 or answer.request.url.path in ("/", "/runs")


def test_an_uploaded_log_is_stored_in_its_own_folder_under_a_safe_name(client: TestClient, runs: Path) -> None:
    name = client.post("/drop?name=..%2F..%2F<b>my log.CSV", content=TABLE, headers=OURS).json()["name"]
    kept = list((runs / name).iterdir())
    assert [p.name for p in kept] == ["b_my_log.CSV"]
    assert kept[0].read_bytes() == TABLE
    assert client.get(f"/runs/{name}").json()["log"] == "b_my_log.CSV"


@pytest.mark.parametrize("name", ["", "a", "a.toml", "a.html", "..csv", ".csv", "a.csv/b", "a.py"])
def test_a_file_that_is_not_a_log_is_rejected(client: TestClient, runs: Path, name: str) -> None:
    before = set(runs.iterdir())
    answer = client.post("/drop", params={"name": name}, content=b"x", headers=OURS)
    assert answer.status_code == 400
    assert ".tlog" in answer.json()["error"]
    assert set(runs.iterdir()) == before


def test_a_too_large_file_leaves_nothing_with_or_without_a_declared_size(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive_module, "MOST_BYTES", 1000)
    before = set(runs.iterdir())

    async def pieces() -> AsyncIterator[bytes]:
        for _ in range(20):
            yield b"x" * 100

    for size in (2000, None, 10):
        with pytest.raises(UsageError, match="larger than"):
            asyncio.run(Archive(runs).take_in("a.csv", size, pieces(), datetime(2026, 1, 1)))
        assert set(runs.iterdir()) == before


def test_a_full_disk_is_reported_and_nothing_is_left(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def pieces() -> AsyncIterator[bytes]:
        yield b"x"
        raise OSError(28, "No space left on device")

    before = set(runs.iterdir())
    with pytest.raises(UsageError, match="No space left"):
        asyncio.run(Archive(runs).take_in("a.csv", None, pieces(), datetime(2026, 1, 1)))
    monkeypatch.setattr(archive_module.shutil, "disk_usage", lambda path: SimpleNamespace(free=10))
    with pytest.raises(UsageError, match="nearly full"):
        asyncio.run(Archive(runs).take_in("a.csv", 1, pieces(), datetime(2026, 1, 1)))
    assert set(runs.iterdir()) == before


def until_done(client: TestClient) -> dict[str, Any]:
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        while True:
            document = json.loads(socket.receive_text())
            desk = document.get("whole", document).get("desk")
            if desk and not desk["running"]:
                return dict(desk)


@pytest.mark.parametrize(
    ("verb", "words"),
    [("list", "logs list"), ("identify", "identify"), ("diagnose", "diagnose")],
)
def test_a_log_is_processed_by_our_command_line_in_another_process(client: TestClient, verb: str, words: str) -> None:
    name = client.post("/drop?name=a.csv", content=TABLE, headers=OURS).json()["name"]
    assert client.post("/work", json={"name": name, "verb": verb, "dof": "yaw"}, headers=OURS).status_code == 200
    desk = until_done(client)
    assert (desk["name"], desk["verb"], desk["code"]) == (name, verb, 0)
    assert desk["text"].startswith(f"did {words} ")
    assert desk["text"].splitlines()[1] == "\\x1b[2J<b>"


def test_two_runs_are_compared_and_the_page_is_stored_with_the_first(client: TestClient) -> None:
    one, other = (client.post(f"/drop?name={n}.csv", content=TABLE, headers=OURS).json()["name"] for n in "ab")
    asked = {"name": one, "verb": "compare", "dof": "yaw", "other": other}
    assert client.post("/work", json=asked, headers=OURS).status_code == 200
    text = until_done(client)["text"]
    assert text.startswith("did compare ")
    assert f"{other}/b.csv" in text.splitlines()[0] and f"{one}/comparison.html" in text.splitlines()[0]


@pytest.mark.parametrize(
    "order",
    [{"name": "20260101-run", "verb": "compare", "other": "../x"},
     {"name": "none", "verb": "list"}, {"name": "../x", "verb": "list"}, {"name": "20260101-run", "verb": "restore"},
     {"name": "20260101-run", "verb": "identify", "dof": "--out=/"}],
)  # fmt: skip
def test_impossible_work_is_rejected(client: TestClient, order: dict[str, str]) -> None:
    assert client.post("/work", json=order, headers=OURS).status_code == 400


def test_upload_and_processing_require_the_token(runs: Path) -> None:
    with TestClient(make_app(runs, Access("right"), ECHO), base_url="http://127.0.0.1:8090") as client:
        assert client.post("/drop?name=a.csv", content=TABLE).status_code == 401
        assert client.post("/work", json={"name": "20260101-run", "verb": "list"}).status_code == 401
        assert client.get("/runs").status_code == 200


@pytest.mark.parametrize(
    ("vehicle", "link", "craft"),
    [
        ({"firmware": "ArduRover"}, "/dev/ttyUSB0,57600", "ArduRover on /dev/ttyUSB0,57600"),
        ("ArduSub 4.7.0 (system 1, component 1)", "udpin:0.0.0.0:14550", "ArduSub on udpin:0.0.0.0:14550"),
        ({"firmware": "ArduRover", "simulated": True}, "sitl:charlie", "sitl:charlie"),
        (None, "", ""),
    ],
)
def test_a_run_is_listed_with_its_date_and_craft(tmp_path: Path, vehicle: object, link: str, craft: str) -> None:
    folder = tmp_path / "20260101-run"
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps({"when": "2026-01-01T12:34:56", "vehicle": vehicle}))
    (folder / "journal.jsonl").write_text(json.dumps({"link": link}) + "\n")
    (entry,) = Archive(tmp_path).entries()
    assert (entry["when"], entry["craft"]) == ("2026-01-01 12:34", craft)
