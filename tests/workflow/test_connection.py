"""Leaving the craft: trouble on the way out does not hide what is left to be done."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.errors import LinkLost, NotAsFound
from gcs_autotune.link import MemoryLink, Session, open_craft
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import CommonSettings, Connection, connection
from sitl import open_vehicle


@pytest.fixture
def silent_craft(monkeypatch: pytest.MonkeyPatch) -> None:
    """A craft that falls silent while the sticks are let go of."""

    def silent() -> None:
        raise LinkLost("silent for 5.0 s")

    session = SimpleNamespace(
        transport=SimpleNamespace(is_simulated=True), notes=[], listen=lambda name, listener: None
    )
    craft = SimpleNamespace(
        session=SimpleNamespace(vehicle=None),
        release=silent,
        rates=SimpleNamespace(restore=lambda: None),
        shielded=nullcontext,
    )
    monkeypatch.setattr(connection, "connect", lambda *_: nullcontext(session))
    monkeypatch.setattr(connection, "open_craft", lambda *_, **__: craft)


def come() -> Any:
    nothing: Any = None
    common = CommonSettings(Connection("memory"), Path("run"))
    return connection.connect_craft(common, nothing, SilentObserver(), nothing, "heading")


@pytest.mark.usefixtures("silent_craft")
def test_a_link_lost_on_leaving_does_not_hide_the_restore_instruction() -> None:
    with pytest.raises(NotAsFound, match="gcs-autotune restore"), come():
        raise NotAsFound("run `gcs-autotune restore`", differences={"mode": "silent"})


@pytest.mark.usefixtures("silent_craft")
def test_a_link_lost_on_leaving_is_reported_without_another_error() -> None:
    with pytest.raises(LinkLost), come():
        pass


@pytest.mark.parametrize(
    ("vehicle", "twitched"),
    [
        ("charlie", "the steering by 5 %, without thrust,"),
        ("blueboat", "the turning thrusters by 5 % to check"),
        ("bluerov2", "the turning thrusters by 5 % to check"),
    ],
)
def test_the_announced_twitch_matches_how_the_craft_steers(vehicle: str, twitched: str) -> None:
    with Session(MemoryLink(open_vehicle(vehicle, seed=1), quantum=0.02)) as session:
        craft = open_craft(session)
        announced = connection.arming(craft).text
    assert announced.startswith("arm the vehicle, and disarm it at the end; move ")
    assert twitched in announced
