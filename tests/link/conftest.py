from __future__ import annotations

from collections.abc import Iterator

import pytest
from scripted_vehicle import BOAT, ROV, ScriptedVehicle

from gcs_autotune.link import MemoryLink, Parameters, Session


@pytest.fixture
def boat() -> ScriptedVehicle:
    return ScriptedVehicle(BOAT)


@pytest.fixture
def rov() -> ScriptedVehicle:
    return ScriptedVehicle(ROV)


@pytest.fixture
def session(boat: ScriptedVehicle) -> Iterator[Session]:
    """A session on a scripted boat, discovered."""
    with Session(MemoryLink(boat)) as session:
        session.discover()
        yield session


@pytest.fixture
def parameters(session: Session) -> Parameters:
    return Parameters(session)
