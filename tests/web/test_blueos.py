"""The extension for BlueOS, as far as it can be tried without it: image, labels, answers, another's path."""

from __future__ import annotations

import json
import re
import struct
import tomllib
from pathlib import Path
from typing import Any

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


def test_the_labels_are_those_that_blueos_reads_and_their_json_is_whole():
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


def test_the_permissions_ask_for_no_more_than_is_needed():
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


def test_the_image_starts_what_there_is_with_runs_on_the_mount():
    command = json.loads(re.search(r"^ENTRYPOINT (\[.*\])$", DOCKERFILE, re.MULTILINE)[1])
    assert command[0] == "gcs-autotune"
    args = make_parser().parse_args(command[1:])
    assert (args.command, args.host, args.port, args.runs) == ("serve", "0.0.0.0", 8090, Path("/data/runs"))
    warmed = re.search(r"warm_up\((\[.*?\]), (\[.*?\])\)", DOCKERFILE)
    dofs, laws = (json.loads(text.replace("'", '"')) for text in warmed.groups())
    assert set(dofs) <= set(DOFS)
    assert set(laws) <= set(LAWS)
    for copied in re.findall(r"^COPY (.*) \S+$", DOCKERFILE, re.MULTILINE):
        assert all((ROOT / name).exists() for name in copied.split())


def test_the_link_that_the_image_names_is_one_and_the_page_begins_with_it(monkeypatch):
    named = re.search(rf"^ENV {LINK_VARIABLE}=(\S+)$", DOCKERFILE, re.MULTILINE)[1]
    open_link(named.replace("host.docker.internal", "127.0.0.1")).close()
    monkeypatch.setenv(LINK_VARIABLE, named)
    assert fields()["link"] == named
    monkeypatch.delenv(LINK_VARIABLE)
    assert fields()["link"] == ""


def test_blueos_and_cockpit_are_answered_without_a_token_and_find_what_they_are_told_of(behind_a_prefix):
    told: dict[str, Any] = behind_a_prefix.get(f"{PREFIX}/register_service").json()
    needed = ("name", "description", "icon", "company", "version", "webpage", "api")
    assert all(isinstance(told[key], str) and told[key] for key in needed)
    assert told["works_in_relative_paths"] is True
    extras = behind_a_prefix.get(PREFIX + told["extras"]["cockpit"])
    assert extras.status_code == 200
    assert {"targetSystem", "targetCockpitApiVersion", "widgets", "actions"} == set(extras.json())
    (widget,) = extras.json()["widgets"]
    assert widget["useExtensionPathAsBaseUrl"] is True
    for url in (widget["iframeUrl"], widget["iframeIcon"]):
        assert behind_a_prefix.get(PREFIX + url).status_code == 200


def test_every_address_in_the_page_is_relative_and_leads_somewhere_under_a_prefix(behind_a_prefix):
    page = behind_a_prefix.get(f"{PREFIX}/")
    assert page.status_code == 200
    links = re.findall(r'(?:src|href)="(?!data:)([^"#]+)"', page.text)
    assert links
    for link in links:
        assert not link.startswith(("/", "http"))
        assert behind_a_prefix.get(f"{PREFIX}/{link}").status_code == 200, link


def test_behind_blueos_nobody_touches_without_the_token(behind_a_prefix):
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
