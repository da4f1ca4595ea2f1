"""The server as seen by a browser, with a scripted run instead of a flight."""

from __future__ import annotations

import asyncio
import io
import json
import sys
import zipfile
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from gcs_autotune.cli import make_parser
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres import MANOEUVRES, ManoeuvreKind
from gcs_autotune.mavlink import load_params
from gcs_autotune.web import Access, CommandLine, make_app
from gcs_autotune.web.access import TOKEN_HEADER
from gcs_autotune.web.app import FILES, STATIC
from gcs_autotune.web.archive import loop_of
from gcs_autotune.web.desk import VERBS
from gcs_autotune.web.job import Job, how_it_ended, how_the_undo_ended, how_to_continue
from gcs_autotune.web.live import Live
from gcs_autotune.web.orders import fields, make_order

SCRIPT = Path(__file__).with_name("scripted_run.py")
PROGRAM = CommandLine((sys.executable, str(SCRIPT)))
NOW = datetime(2026, 11, 23)
OURS = {TOKEN_HEADER: "none"}
HEADING = {"job": "tune", "axis": "heading", "connect": "udpin:127.0.0.1:14550"}


def client_of(runs: Path, access: Access | None = None, program: CommandLine = PROGRAM) -> TestClient:
    return TestClient(make_app(runs, access or Access(), program), base_url="http://127.0.0.1:8090")


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with client_of(tmp_path) as one:
        yield one


class Viewer:
    """Keeps the document in step, as the page does."""

    def __init__(self, socket: WebSocketTestSession) -> None:
        self.socket = socket
        self.state: dict[str, Any] = {}

    def until(self, key: str) -> dict[str, Any]:
        while not self.state.get(key):
            delta = json.loads(self.socket.receive_text())
            if "whole" in delta:
                self.state = delta["whole"]
            elif delta.get("fresh"):
                self.state = {"rows": [], "words": [], "legs": []}
            for name, value in delta.items():
                if name.startswith("+"):
                    self.state[name[1:]] += value
                elif name != "whole":
                    self.state[name] = value
        return self.state


def test_a_run_is_started_viewed_and_stopped_and_the_restored_values_are_reported(client: TestClient) -> None:
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        viewer = Viewer(socket)
        assert client.post("/start", json=HEADING, headers=OURS).status_code == 200
        state = viewer.until("question")
        assert state["now"]["steps"] == 8
        assert len(state["rows"]) == 3
        assert state["proposal"]["values"][0]["parameter"] == "ATC_STR_RAT_P"
        assert client.post("/start", json=HEADING, headers=OURS).status_code == 409
        assert client.post("/stop", headers=OURS).json() == {"stopping": True}
        for _ in range(2):  # once is as good as often, also when it is over by then
            assert client.post("/stop", headers=OURS).status_code == 200
        end = viewer.until("end")["end"]
    assert (end["code"], end["fine"]) == (130, True)
    assert end["reason"] == "stopped by the operator"
    assert "mode HOLD, disarmed, as before the run" in end["put_back"][0]
    assert "all 2 as before the run" in end["put_back"][1]
    assert client.post("/stop", headers=OURS).json() == {"stopping": False}


def test_an_interrupted_run_ends_with_the_command_that_continues_it(client: TestClient) -> None:
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        viewer = Viewer(socket)
        client.post("/start", json={**HEADING, "connect": "story:aborted"}, headers=OURS)
        resume = viewer.until("end")["end"]["resume"]
    assert resume["command"] == "gcs-autotune tune heading --connect /dev/ttyUSB0 --resume runs/lake"
    assert resume["text"].endswith("change --max-speed and keep the other options:")
    assert how_to_continue(["connected", "done"]) == {}


def test_the_key_of_a_joystick_stops_a_run(tmp_path: Path) -> None:
    with (
        client_of(tmp_path, Access("right", stop_key="only-stop")) as client,
        client.websocket_connect("ws://127.0.0.1:8090/live") as socket,
    ):
        viewer = Viewer(socket)
        client.post("/start", json=HEADING, headers={TOKEN_HEADER: "right"})
        viewer.until("question")
        assert client.post("/joystick-stop?key=only-stop").json() == {"stopping": True}
        assert viewer.until("end")["end"]["code"] == 130


def test_only_the_first_answer_counts(client: TestClient) -> None:
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        viewer = Viewer(socket)
        client.post("/start", json=HEADING, headers=OURS)
        viewer.until("question")
        wrong = client.post("/answer", json={"id": 7, "yes": True}, headers=OURS)
        first = client.post("/answer", json={"id": 1, "yes": True}, headers=OURS)
        second = client.post("/answer", json={"id": 1, "yes": False}, headers=OURS)
        assert [each.json()["counted"] for each in (wrong, first, second)] == [False, True, False]
        end = viewer.until("end")["end"]
    assert end["code"] == 0
    assert "ATC_STR_RAT_P 0.2 -> 0.4" in end["put_back"][1]


def test_a_stop_sent_before_the_process_starts_reaches_it(tmp_path: Path) -> None:
    live = Live()
    live.begin({"name": "run"})
    job = Job(PROGRAM, [f"--out={tmp_path / 'run'}"], tmp_path / "run", live)

    async def scene() -> None:
        job.stop()
        await asyncio.wait_for(job.run(), 60.0)

    asyncio.run(scene())
    assert live.get("end")["code"] == 130


def test_viewers_connect_and_leave_without_effect_on_the_run(client: TestClient) -> None:
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        client.post("/start", json=HEADING, headers=OURS)
        Viewer(socket).until("question")
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        again = Viewer(socket)
        assert len(again.until("question")["rows"]) == 3
        assert again.state.get("end") is None
        client.post("/stop", headers=OURS)
        assert again.until("end")["end"]["code"] == 130


def test_the_server_stops_the_run_and_waits_for_it_on_exit(tmp_path: Path) -> None:
    with client_of(tmp_path) as client, client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        name = client.post("/start", json=HEADING, headers=OURS).json()["name"]
        Viewer(socket).until("question")
    assert (tmp_path / name / "parameters_after.json").exists()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")
def test_the_footer_states_that_proved_gains_stay() -> None:
    footer = " ".join((STATIC / "index.html").read_text(encoding="utf-8").split())
    assert "parameters restored, except gains already proved better" in footer


def test_a_disk_that_fills_during_a_tune_is_reported_and_everything_is_restored(tmp_path: Path) -> None:
    program = CommandLine((sys.executable, str(Path(__file__).with_name("full_disk.py"))))
    with (
        client_of(tmp_path, program=program) as client,
        client.websocket_connect("ws://127.0.0.1:8090/live") as socket,
    ):
        name = client.post("/start", json={**HEADING, "connect": ""}, headers=OURS).json()["name"]
        end = Viewer(socket).until("end")["end"]
        assert client.get("/runs").status_code == 200
    assert f"the run directory {tmp_path / name} cannot be written" in end["reason"]
    assert "Free some disk space" in end["reason"]
    assert end["put_back"] == [
        "Actuators neutral, confirmed at the outputs; mode HOLD, disarmed, as before the run.",
        "The run did not record the parameters at its end.",
    ]


def test_server_sent_events_carry_the_same_state(tmp_path: Path) -> None:
    async def scene() -> list[bytes]:
        """Request as a browser does and leave after the first event: the test client would wait for ever."""
        sent: list[bytes] = []
        gone = asyncio.Event()
        scope = {
            "type": "http", "asgi": {"version": "3.0", "spec_version": "2.3"}, "http_version": "1.1", "method": "GET",
            "path": "/events", "raw_path": b"/events", "query_string": b"", "root_path": "", "scheme": "http",
            "headers": [(b"host", b"127.0.0.1")], "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 8090),
        }  # fmt: skip

        async def receive() -> dict[str, Any]:
            await gone.wait()
            return {"type": "http.disconnect"}

        async def send(message: Any) -> None:
            if message["type"] == "http.response.start":
                sent.extend(value for name, value in message["headers"] if name == b"content-type")
            elif message.get("body"):
                sent.append(message["body"])
                gone.set()

        await make_app(tmp_path, Access(), PROGRAM)(scope, receive, send)
        return sent

    kind, first = asyncio.run(scene())
    assert kind.startswith(b"text/event-stream")
    assert first.startswith(b'data: {"whole":')
    assert first.endswith(b"\n\n")


@pytest.mark.parametrize("where", ["/start", "/stop", "/answer", "/token"])
def test_without_the_token_requests_are_rejected_and_viewing_is_allowed(where: str, tmp_path: Path) -> None:
    with client_of(tmp_path, Access("right")) as client:
        assert client.post(where, json=HEADING).status_code == 401
        assert client.post(where, json=HEADING, headers={TOKEN_HEADER: "wrong"}).status_code == 403
        assert client.get("/").status_code == 200
        assert client.get("/about").json()["token_needed"]
        with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
            assert "whole" in json.loads(socket.receive_text())
        assert client.post("/token", headers={TOKEN_HEADER: "right"}).status_code == 200


def test_a_form_of_another_page_is_rejected_even_without_a_token(client: TestClient) -> None:
    assert client.post("/stop").status_code == 403  # a form cannot set the header
    assert client.post("/stop", headers={**OURS, "Origin": "http://evil.example"}).status_code == 403
    assert client.post("/stop", headers={**OURS, "Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert client.get("/about", headers={"Host": "evil.example"}).status_code == 403
    assert client.get("/stop").status_code == 405
    assert client.options("/stop", headers={"Origin": "http://evil.example"}).status_code == 403


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"host": "evil.example"}])
def test_a_socket_of_another_page_is_rejected(client: TestClient, headers: dict[str, str]) -> None:
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect("ws://127.0.0.1:8090/live", headers=headers) as socket,
    ):
        socket.receive_text()


def test_every_response_forbids_foreign_scripts(client: TestClient) -> None:
    for where in ("/", "/about", "/nothing", "/static/main.js"):
        policy = client.get(where).headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert client.get(where).headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    ("chosen", "text"),
    [
        ({**HEADING, "axis": "sideways"}, "sideways"),
        ({**HEADING, "job": "restore"}, "restore"),
        ({**HEADING, "numbers": {"max-roll": "1e9"}}, "max-roll: 1000000000 is out of range"),
        ({**HEADING, "numbers": {"--out": "/etc"}}, "unknown setting '--out'"),
        ({**HEADING, "numbers": {"step": "30; rm"}}, "is not a number"),
        ({**HEADING, "numbers": ["step"]}, "not an object"),
        ({**HEADING, "numbers": {"full-scale": "40"}}, "full-scale applies only to a model"),
        ({**HEADING, "connect": "udpin:\n--yes"}, "not a connection URI"),
        ({"job": "fly", "manoeuvre": "zigzag"}, "zig-zag"),
        ({"job": "fly", "manoeuvre": "step"}, "not flown by itself, but by tune AXIS"),
        ({"job": "fly", "manoeuvre": "zig-zag", "force": "Y"}, "cannot drive the force 'Y'"),
        ({"job": "fly", "manoeuvre": "zig-zag", "first_to": "up"}, "starboard"),
        ({"job": "fly", "manoeuvre": "zig-zag", "area": "44.4,8.9 44.5,8.9"}, "area"),
        ({"job": "fly", "manoeuvre": "zig-zag", "area": "/etc/lake.geojson"}, "lat,lon"),
        ({"job": "fly", "manoeuvre": "zig-zag", "numbers": {"duration": "9"}}, "unknown setting 'duration'"),
        ({"job": "fly", "manoeuvre": "zig-zag", "numbers": {"heading": "900"}}, "heading: 900 is out of range"),
    ],
)
def test_impossible_choices_are_rejected_by_name_before_the_start(
    client: TestClient, tmp_path: Path, chosen: dict[str, Any], text: str
) -> None:
    answer = client.post("/start", json=chosen, headers=OURS)
    assert answer.status_code == 400
    assert text in answer.json()["error"]
    assert list(tmp_path.iterdir()) == []


def test_choices_become_a_valid_command_line(tmp_path: Path) -> None:
    numbers = {"steering": "0.3", "f-stop": "0.4", "max-time": "300", "relays": "3", "throttle": ""}
    chosen = {
        "job": "fly",
        "manoeuvre": "chirp",
        "force": "Z",
        "first_to": "port",
        "numbers": numbers,
        "fetch_log": True,
        "area": "-33.1,8.9 -33.1,9.0 -33.2,9.0",
    }
    order = make_order(chosen, tmp_path, datetime(2026, 11, 23))
    args = make_parser().parse_args(list(order.arguments))
    assert (args.manoeuvre, args.force, args.first_to, args.fetch_log) == ("chirp", "Z", "port", True)
    assert (args.steering, args.f_stop, args.max_time, args.throttle) == (0.3, 0.4, 300.0, None)
    assert args.area == chosen["area"]
    assert args.connect == "sitl:bluerov2"  # a craft that has that force
    assert not args.preview
    preview = make_order({**chosen, "dry_run": True}, tmp_path, datetime(2026, 11, 23))
    assert make_parser().parse_args(list(preview.arguments)).preview


@pytest.mark.parametrize("kind", [kind for kind in MANOEUVRES.values() if kind.is_alone], ids=lambda kind: kind.name)
def test_every_manoeuvre_can_be_chosen_with_each_force_and_its_options(kind: ManoeuvreKind, tmp_path: Path) -> None:
    (offered,) = [each for each in fields()["manoeuvres"] if each["name"] == kind.name]
    assert [option["name"] for option in offered["options"]] == list(kind.options)
    for force in offered["forces"] or [""]:
        order = make_order({"job": "fly", "manoeuvre": kind.name, "force": force}, tmp_path, datetime(2026, 11, 23))
        assert make_parser().parse_args(list(order.arguments)).force == force


def test_empty_fields_show_the_value_of_the_settings_file(tmp_path: Path) -> None:
    otter = {"connect": "udpin:0.0.0.0:14561", "max-speed": 2.0, "signing-key": tmp_path / "key"}
    preset = {"connect": "/dev/ttyUSB0,57600", "max-distance": 40.0, "craft": {"otter": otter}}
    with TestClient(make_app(tmp_path, Access(), PROGRAM, preset), base_url="http://127.0.0.1:8090") as one:
        about = one.get("/about").json()
    everyday = {field["name"]: field["by_axis"][""]["usual"] for field in about["numbers"][about["everyday"]]}
    assert (about["link"], everyday["max-distance"]) == ("/dev/ttyUSB0,57600", "40 (gcs-autotune.toml)")
    assert "toml" not in everyday["max-time"]
    assert about["presets"] == {"otter": {"connect": "udpin:0.0.0.0:14561", "numbers": {"max-speed": "2"}}}
    order = make_order({"job": "tune", "axis": "heading", "craft": "otter"}, tmp_path, NOW)
    assert make_parser().parse_args(list(order.arguments)).craft == "otter"


def test_the_ports_command_listens_to_ports_but_never_during_a_run(tmp_path: Path) -> None:
    program = CommandLine((sys.executable, "-c", "import sys; print(sys.argv[1:])"))
    with client_of(tmp_path, program=program) as one, one.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        assert one.post("/work", json={"verb": "ports"}, headers=OURS).status_code == 200
        viewer = Viewer(socket)
        while viewer.until("desk")["desk"]["running"]:
            viewer.state.pop("desk")
        assert viewer.state["desk"]["text"] == "['ports', '--json']\n"
    with client_of(tmp_path) as one, one.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        one.post("/start", json=HEADING, headers=OURS)
        Viewer(socket).until("question")
        assert one.post("/work", json={"verb": "ports"}, headers=OURS).status_code == 409


def test_a_guided_run_is_tune_all_with_its_options(tmp_path: Path) -> None:
    chosen = {"job": "all", "style": "gentle", "dry_run": True, "model": "a/b.json", "axis": "heading"}
    numbers = {"step": "30", "full-scale": "40", "relays": "3", "max-distance": "40"}
    order = make_order({**chosen, "numbers": numbers}, tmp_path, datetime(2026, 11, 23))
    args = make_parser().parse_args(list(order.arguments))
    assert (args.axis, args.style, args.dry_run, args.relays, args.max_distance) == ("all", "gentle", True, 3, 40.0)
    assert (args.step, args.model, args.full_scale, args.resume) == (None, None, None, None)
    with pytest.raises(UsageError, match="sudden"):
        make_order({**chosen, "style": "sudden"}, tmp_path, datetime(2026, 11, 23))


def job_of(folder: Path, link: str, *endings: str) -> Path:
    """Write a guided run on *link* whose steps ended as stated."""
    (folder / "01-heading").mkdir(parents=True)
    (folder / "01-heading" / "journal.jsonl").write_text(json.dumps({"event": "opened", "link": link}) + "\n")
    steps = [{"name": f"loop {k}", "ending": each, "gains": {"P": [1, 2]}} for k, each in enumerate(endings)]
    (folder / "job.json").write_text(json.dumps({"style": "quick", "dry_run": False, "steps": steps}))
    return folder


def test_a_stopped_guided_run_continues_in_its_own_directory(tmp_path: Path) -> None:
    folder = job_of(tmp_path / "lake", "/dev/ttyUSB0", "kept", "aborted")
    with client_of(tmp_path) as one:
        resume = one.get("/runs/lake").json()["resume"]
    order = make_order(resume, tmp_path, datetime(2026, 11, 23))
    args = make_parser().parse_args(list(order.arguments))
    assert (args.axis, args.resume, args.connect, args.style) == ("all", folder, "/dev/ttyUSB0", "quick")
    assert order.directory == folder and args.out is None
    with pytest.raises(UsageError, match="does not exist"):
        make_order({**resume, "resume": "../etc"}, tmp_path, datetime(2026, 11, 23))


def test_a_stopped_run_states_the_command_that_continues_it(tmp_path: Path) -> None:
    how = {"text": "To continue:", "command": "gcs-autotune tune heading --resume runs/lake"}
    for name, summary in (("lake", {"ending": "aborted", "resume": how}), ("pond", {"ending": "kept"})):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(json.dumps(summary))
    with client_of(tmp_path) as one:
        assert [one.get(f"/runs/{name}").json()["way_on"] for name in ("lake", "pond")] == [how, {}]


def test_a_finished_or_simulated_guided_run_cannot_be_continued(tmp_path: Path) -> None:
    job_of(tmp_path / "done", "/dev/ttyUSB0", "kept", "restored")
    job_of(tmp_path / "simulated", "sitl:charlie", "kept", "open")
    with client_of(tmp_path) as one:
        assert [one.get(f"/runs/{name}").json()["resume"] for name in ("done", "simulated")] == [None, None]


def test_the_end_of_a_guided_run_states_the_result_of_each_step(tmp_path: Path) -> None:
    folder = job_of(tmp_path / "lake", "/dev/ttyUSB0", "kept", "restored", "open")
    left = {"mode": "HOLD", "armed": False, "differs": {}}
    end = how_it_ended(8, "", folder, left)
    assert end["meaning"] == "done, and some loops have their old gains"
    assert end["put_back"][1:] == [
        "loop 0: the new gains are better and stay: P 1 -> 2.",
        "loop 1: the new gains were not better in every respect, and the old ones are restored.",
        "loop 2: not flown.",
    ]
    assert not how_it_ended(130, "", folder, None)["fine"]  # a step was flown, and how it left the craft is unknown


def kept_run(folder: Path, link: str, *, settled: bool = True, ending: str = "kept") -> Path:
    """Write a run that changed a gain of the vehicle on *link*."""
    folder.mkdir()
    lines: list[dict[str, Any]] = [{"event": "opened", "time": "2026-11-26T21:19:09+00:00", "schema": 1, "link": link}]
    lines += [{"event": "closed", "time": "2026-11-26T21:20:09+00:00"}] * settled
    (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    (folder / "summary.json").write_text(json.dumps({"title": "tune heading", "ending": ending}))
    (folder / "parameters_before.param").write_text("ATC_STR_RAT_P,0.2\n")
    return folder


@pytest.mark.parametrize("settled", [True, False])
def test_a_run_ended_before_arming_is_fine_if_earlier_steps_restored_the_vehicle(tmp_path: Path, settled: bool) -> None:
    (tmp_path / "job").mkdir()
    kept_run(tmp_path / "job" / "01-heading", "/dev/ttyUSB0", settled=settled)
    end = how_it_ended(130, "", tmp_path / "job", None)
    assert end["fine"] == settled
    assert ("vehicle is restored" in end["put_back"][0]) == settled


def test_kept_gains_are_undone_by_restoring_the_parameters(tmp_path: Path) -> None:
    folder = kept_run(tmp_path / "lake", "/dev/ttyUSB0")
    with client_of(tmp_path) as one:
        assert one.get("/runs/lake").json()["undo"]
    args = make_parser().parse_args(list(make_order({"job": "undo", "run": "lake"}, tmp_path, NOW).arguments))
    assert (args.action, args.file, args.remote, args.yes) == (
        "restore",
        folder / "parameters_before.param",
        True,
        False,
    )


def test_an_unrestored_run_is_restored_by_the_restore_command(tmp_path: Path) -> None:
    folder = kept_run(tmp_path / "lake", "/dev/ttyUSB0", settled=False, ending="aborted")
    args = make_parser().parse_args(list(make_order({"job": "undo", "run": "lake"}, tmp_path, NOW).arguments))
    assert (args.command, args.run, args.yes) == ("restore", folder, False)


@pytest.mark.parametrize(("link", "ending"), [("sitl:charlie", "kept"), ("/dev/ttyUSB0", "restored"), ("", "kept")])
def test_a_run_without_kept_gains_or_vehicle_cannot_be_undone(tmp_path: Path, link: str, ending: str) -> None:
    kept_run(tmp_path / "lake", link, ending=ending)
    with pytest.raises(UsageError, match="nothing to undo"):
        make_order({"job": "undo", "run": "lake"}, tmp_path, NOW)


def test_a_run_with_a_loop_model_offers_what_if_and_proves_the_gains_shown(
    tmp_path: Path,
) -> None:
    folder = kept_run(tmp_path / "lake", "/dev/ttyUSB0")
    assert loop_of(folder) == ""
    (folder / "summary.json").write_text(json.dumps({"axis": "heading"}))
    assert loop_of(folder) == ""
    (folder / "model.json").write_text("{}")
    with client_of(tmp_path) as one:
        entry = one.get("/runs/lake").json()
    words = VERBS["what-if"](folder, folder, "yaw", folder)
    args = make_parser().parse_args(words)
    assert (args.loop, args.styles, entry["loop"]) == ("heading", folder / "styles.json", "heading")
    gains = [
        {"parameter": "ATC_STR_ANG_P", "old": 2.0, "new": 1.25},
        {"parameter": "ATC_STR_RAT_P", "old": 0.2, "new": 0.2},
    ]
    designs = [{"style": "38", "at": 38.0, "gains": gains}, {"style": "quick", "error": "none"}]
    (folder / "styles.json").write_text(json.dumps({"schema": 2, "styles": designs}))
    numbers = {"settling-time": "4", "full-scale": "2", "max-distance": "50"}  # of a run that designed
    proof = {"job": "tune", "axis": "heading", "style": "38", "model": "lake/styles.json", "numbers": numbers}
    tune = make_parser().parse_args(list(make_order({**proof, "connect": entry["link"]}, tmp_path, NOW).arguments))
    assert (tune.style, tune.gains, tune.model) == ("38", folder / "style-38.param", None)
    assert (tune.connect, tune.yes, tune.max_distance, tune.settling_time) == ("/dev/ttyUSB0", False, 50.0, None)
    assert load_params(tune.gains) == {"ATC_STR_ANG_P": 1.25, "ATC_STR_RAT_P": 0.2}
    for style in ("quick", "62", "../../x"):
        with pytest.raises(UsageError, match="no new gains to prove"):
            make_order({**proof, "style": style}, tmp_path, NOW)


def test_a_run_is_downloaded_without_foreign_files(tmp_path: Path) -> None:
    (kept_run(tmp_path / "lake", "/dev/ttyUSB0") / "signing.key").write_text("secret")
    with client_of(tmp_path) as one:
        answer = one.get("/zip/lake")
        assert one.get("/zip/%2e%2e").status_code == 404
    with zipfile.ZipFile(io.BytesIO(answer.content)) as whole:
        names = [f"lake/{name}" for name in ("journal.jsonl", "parameters_before.param", "summary.json")]
        assert whole.namelist() == names


def test_the_choices_of_a_run_are_stored_to_start_it_again(client: TestClient) -> None:
    with client.websocket_connect("ws://127.0.0.1:8090/live") as socket:
        name = client.post("/start", json=HEADING, headers=OURS).json()["name"]
        viewer = Viewer(socket)
        viewer.until("question")
        client.post("/stop", headers=OURS)
        viewer.until("end")
    assert client.get(f"/runs/{name}").json()["again"] == HEADING


def test_an_undo_asks_first_and_ends_with_the_restored_values() -> None:
    reported = [
        "connected",
        "answered yes: Write P 2 -> 1?",
        "P: 2 -> 1",
        "1 parameter changed, verified by reading back",
    ]
    end = how_the_undo_ended(0, "", reported)
    assert end["fine"] and end["put_back"] == reported[2:]
    declined = how_the_undo_ended(130, "gcs-autotune: nothing was written: the answer was no\n", reported[:1])
    assert (declined["fine"], declined["put_back"]) == (False, [])
    assert declined["reason"] == "nothing was written: the answer was no"


def test_a_new_step_begins_without_the_proposal_of_the_last_one() -> None:
    live = Live()
    for state, kept in (("open", True), ("flying", False)):
        live.take(b'{"proposal": {"values": []}}')
        live.take(json.dumps({"steps": {"steps": [{"name": "depth", "state": state}]}}).encode())
        assert (live.get("proposal") is not None) == kept


def test_only_models_of_earlier_runs_can_be_used_for_design_and_preview(tmp_path: Path) -> None:
    model = tmp_path / "20261123-lake" / "diagnosis" / "model.json"
    model.parent.mkdir(parents=True)
    model.write_text("{}")
    (model.parent / "else.json").symlink_to("/etc/hostname")
    with client_of(tmp_path) as one:
        (entry,) = one.get("/runs").json()["entries"]
    assert entry["models"] == ["diagnosis/model.json"]
    chosen = f"{entry['name']}/{entry['models'][0]}"
    for what in ({**HEADING, "numbers": {"full-scale": "40"}}, {"job": "fly", "manoeuvre": "zig-zag"}):
        order = make_order({**what, "model": chosen}, tmp_path, datetime(2026, 11, 23))
        assert make_parser().parse_args(list(order.arguments)).model == model
    for wrong in ("20261123-lake/../../etc/x.json", "20261123-lake/diagnosis/else.json", "20261123-lake", "a/b.csv"):
        with pytest.raises(UsageError, match="model: "):
            make_order({**HEADING, "model": wrong}, tmp_path, datetime(2026, 11, 23))


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"x" * 100_000, b"null"])
def test_a_malformed_request_is_rejected_without_effect(client: TestClient, body: bytes) -> None:
    for where in ("/start", "/answer"):
        answer = client.post(where, content=body, headers=OURS)
        assert answer.status_code == 400
        assert answer.json()["error"]


def test_only_the_files_of_the_page_are_served(client: TestClient) -> None:
    for name in ("..%2Fapp.py", "%2e%2e/app.py", "index.html", "%2Fetc%2Fpasswd"):
        assert client.get(f"/static/{name}").status_code == 404
    assert {path.name for path in STATIC.iterdir()} == {*FILES, "index.html"}
    assert [client.get(f"/static/{name}").status_code for name in FILES] == [200] * len(FILES)


def test_the_page_is_small_and_loads_nothing_external() -> None:
    sizes = {path.name: path.stat().st_size for path in STATIC.iterdir()}
    assert sum(sizes.values()) < 300_000
    for path in STATIC.iterdir():
        text = path.read_text(encoding="utf-8")
        if path.name.startswith("uPlot"):
            continue
        assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")  # a name, not an address
        assert "https://" not in text
        assert "innerHTML" not in text
        assert 'src="/' not in text
        assert 'href="/' not in text
