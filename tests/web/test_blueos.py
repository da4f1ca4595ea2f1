"""The BlueOS extension, as far as it can be tested without BlueOS: image, labels, responses, path prefix."""

from __future__ import annotations

import json
import re
import struct
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.testclient import TestClient

from gcs_autotune.cli import make_parser
from gcs_autotune.design import LAWS
from gcs_autotune.link import open_link
from gcs_autotune.sname import DOFS
from gcs_autotune.web import Access, make_app
from gcs_autotune.web.orders import LINK_VARIABLE, fields

ROOT = Path(__file__).parents[2]
EXTENSION = ROOT / "extension"
DOCKERFILE = (EXTENSION / "Dockerfile").read_text()
PREFIX = "/extensionv2/gcsautotune"


def labels() -> dict[str, str]:
    joined = DOCKERFILE.replace("\\\n", "")
    return {name: value for name, _, value in re.findall(r"^LABEL (\w+)=(['\"])(.*)\2$", joined, re.MULTILINE)}


@pytest.fixture
def behind_a_prefix(tmp_path: Path) -> TestClient:
    """The server with a token, as the image starts it, under BlueOS' path and name."""
    app = Starlette(routes=[Mount(PREFIX, make_app(tmp_path, Access("secret")))])
    return TestClient(app, base_url="http://blueos.local")


TEXT = {"type": "string"}
COCKPIT: dict[str, Any] = {
    "type": "object",
    "required": ["targetCockpitApiVersion", "targetSystem", "widgets", "actions"],
    "additionalProperties": False,
    "properties": {
        "targetCockpitApiVersion": TEXT,
        "targetSystem": {"const": "Cockpit"},
        "widgets": {
            "items": {
                "type": "object",
                "required": ["name", "iframeUrl", "iframeIcon"],
                "additionalProperties": False,
                "properties": {
                    **dict.fromkeys(("name", "iframeUrl", "iframeIcon", "collapsibleContainerName", "version"), TEXT),
                    "startCollapsed": {"type": "boolean"},
                    "useExtensionPathAsBaseUrl": {"type": "boolean"},
                },
            }
        },
        "actions": {
            "items": {
                "type": "object",
                "required": ["id", "name", "type", "config"],
                "additionalProperties": False,
                "properties": {
                    **dict.fromkeys(("id", "name", "version"), TEXT),
                    "type": {"enum": ["http-request"]},
                    "config": {
                        "type": "object",
                        "required": ["name", "url", "method", "headers", "urlParams", "body"],
                        "additionalProperties": False,
                        "properties": {
                            **dict.fromkeys(("name", "url", "body"), TEXT),
                            "method": {"enum": ["GET", "POST", "PUT", "DELETE", "PATCH"]},
                            "headers": {"additionalProperties": TEXT},
                            "urlParams": {"additionalProperties": TEXT},
                        },
                    },
                },
            }
        },
    },
}
"""What Cockpit checks ``cockpit_extras.json`` against (its ``ExtrasJsonSchema``), of the kinds we offer."""


def with_a_key(runs: Path) -> TestClient:
    app = Starlette(routes=[Mount(PREFIX, make_app(runs, Access("secret", stop_key="only-stop")))])
    return TestClient(app, base_url="http://blueos.local")


def test_the_labels_are_those_that_blueos_reads_with_valid_json():
    found = labels()
    assert set(found) == {
        "version", "permissions", "authors", "company", "readme", "links", "type", "tags", "requirements"
    }  # fmt: skip
    assert found["version"] == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert found["type"] == "tool"
    for name, keys in (("company", {"name", "about", "email"}), ("links", {"source", "support"})):
        assert set(json.loads(found[name])) == keys
    assert all({"name", "email"} == set(author) for author in json.loads(found["authors"]))
    assert all(isinstance(tag, str) for tag in json.loads(found["tags"]))


def test_the_permissions_are_minimal():
    asked = json.loads(labels()["permissions"])
    host = asked["HostConfig"]
    assert set(asked) == {"ExposedPorts", "HostConfig"}
    assert "Privileged" not in host and "NetworkMode" not in host
    (port,) = asked["ExposedPorts"]
    assert port == "8090/tcp" and port in host["PortBindings"]
    assert host["Binds"] == ["/usr/blueos/extensions/gcs-autotune:/data:rw"]
    assert "host.docker.internal:host-gateway" in host["ExtraHosts"]
    assert 0 < host["CpuQuota"] <= 2 * host["CpuPeriod"]
    assert host["Memory"] >= 512 << 20


def test_the_image_starts_the_server_with_runs_on_the_mount():
    command = json.loads(re.search(r"^ENTRYPOINT (\[.*\])$", DOCKERFILE, re.MULTILINE)[1])
    assert command[0] == "gcs-autotune"
    args = make_parser().parse_args(command[1:])
    assert (args.command, args.host, args.port, args.runs) == ("serve", "0.0.0.0", 8090, Path("/data/runs"))
    assert args.joystick_stop
    warmed = re.search(r"warm_up\((\[.*?\]), (\[.*?\])\)", DOCKERFILE)
    dofs, laws = (json.loads(text.replace("'", '"')) for text in warmed.groups())
    assert set(dofs) <= set(DOFS)
    assert set(laws) <= set(LAWS)
    for copied in re.findall(r"^COPY (.*) \S+$", DOCKERFILE, re.MULTILINE):
        assert all((ROOT / name).exists() for name in copied.split())


def test_the_link_of_the_image_is_valid_and_the_default_of_the_page(monkeypatch):
    named = re.search(rf"^ENV {LINK_VARIABLE}=(\S+)$", DOCKERFILE, re.MULTILINE)[1]
    open_link(named.replace("host.docker.internal", "127.0.0.1")).close()
    monkeypatch.setenv(LINK_VARIABLE, named)
    assert fields()["link"] == named
    monkeypatch.delenv(LINK_VARIABLE)
    assert fields()["link"] == ""


def test_blueos_and_cockpit_need_no_token_and_find_the_announced_addresses(behind_a_prefix):
    document: dict[str, Any] = behind_a_prefix.get(f"{PREFIX}/register_service").json()
    needed = ("name", "description", "icon", "company", "version", "webpage", "api")
    assert all(isinstance(document[key], str) and document[key] for key in needed)
    assert document["works_in_relative_paths"] is True
    extras = behind_a_prefix.get(PREFIX + document["extras"]["cockpit"])
    assert extras.status_code == 200
    assert {"targetSystem", "targetCockpitApiVersion", "widgets", "actions"} == set(extras.json())
    (widget,) = extras.json()["widgets"]
    assert widget["useExtensionPathAsBaseUrl"] is True
    for url in (widget["iframeUrl"], widget["iframeIcon"]):
        assert behind_a_prefix.get(PREFIX + url).status_code == 200


def test_the_cockpit_extras_match_their_schema(behind_a_prefix, tmp_path):
    where = behind_a_prefix.get(f"{PREFIX}/register_service").json()["extras"]["cockpit"]
    without = behind_a_prefix.get(PREFIX + where).json()
    with_stop = with_a_key(tmp_path).get(PREFIX + where).json()
    for reported in (without, with_stop):
        jsonschema.validate(reported, COCKPIT)
    assert without["actions"] == []
    assert [action["id"] for action in with_stop["actions"]] == ["gcs-autotune-stop"]


def test_the_joystick_key_stops_from_any_page_and_does_nothing_else(tmp_path):
    client = with_a_key(tmp_path)
    ((action,),) = [client.get(f"{PREFIX}/cockpit_extras.json").json()["actions"]]
    asked = action["config"]
    address = asked["url"].replace("{{ vehicle-address }}", "blueos.local")
    cockpit = {"Origin": "http://localhost:5173", "Sec-Fetch-Site": "cross-site"}

    def press(**params: str) -> Any:
        return client.request(asked["method"], address, params=params, headers=cockpit)

    assert press(**asked["urlParams"]).json() == {"stopping": False}  # no run is under way
    assert press().status_code == press(key="wrong").status_code == 403
    assert client.get(address, params=asked["urlParams"]).status_code == 405
    key = asked["urlParams"]["key"]
    for verb in ("stop", "start", "answer", "token"):
        assert client.post(f"{PREFIX}/{verb}", headers={"x-autotune-token": key}, json={}).status_code == 403
        assert client.post(f"{PREFIX}/{verb}", params={"key": key}, json={}).status_code == 401
    assert client.post(f"http://evil.example{PREFIX}/joystick-stop", params=asked["urlParams"]).status_code == 403


def test_no_joystick_key_works_if_none_was_offered(behind_a_prefix):
    for key in ("", "secret", "only-stop"):
        assert behind_a_prefix.post(f"{PREFIX}/joystick-stop", params={"key": key}).status_code == 403


def test_every_address_in_the_page_is_relative_and_works_under_a_prefix(behind_a_prefix):
    page = behind_a_prefix.get(f"{PREFIX}/")
    assert page.status_code == 200
    links = re.findall(r'(?:src|href)="(?!data:)([^"#]+)"', page.text)
    assert links
    for link in links:
        assert not link.startswith(("/", "http"))
        assert behind_a_prefix.get(f"{PREFIX}/{link}").status_code == 200, link


def test_behind_blueos_operating_requires_the_token(behind_a_prefix):
    assert behind_a_prefix.post(f"{PREFIX}/stop").status_code == 401
    right = {"x-autotune-token": "secret"}
    assert behind_a_prefix.post(f"{PREFIX}/stop", headers=right).json() == {"stopping": False}


def test_the_store_has_its_entry_and_a_square_logo():
    entry = json.loads((EXTENSION / "metadata.json").read_text())
    assert set(entry) == {"name", "website", "docker", "description"}
    head = (EXTENSION / "extension_logo.png").read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", head[16:24])
    assert width == height == 512
