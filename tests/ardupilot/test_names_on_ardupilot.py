"""Parameter names and scales on an unmodified ArduSub and ArduRover: read, written, read back and restored."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from firmware_process import KINDS, ArduPilot, binary_of

from gcs_autotune.firmware import FIRMWARE, read_named
from gcs_autotune.link import Parameters, Session, open_link, same_float32

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(300)]
WHOLE = ("CRUISE_THROTTLE",)
"""Parameters that ArduPilot keeps as whole numbers."""
LATER = {"ATC_STR_DEC_MAX", "SURFACE_MAX_THR"}
"""New in 4.7; the design works without them, as older firmware does."""
FIRMWARES = {"rover": "ardurover", "sub": "ardusub"}


@pytest.fixture(scope="module", params=list(KINDS))
def aboard(request: pytest.FixtureRequest) -> Iterator[tuple[str, Parameters]]:
    kind = KINDS[request.param]
    binary = binary_of(kind)
    if binary is None:
        pytest.skip(f"{kind.variable} is not set")
    with ArduPilot(kind, binary, speedup=1.0) as firmware, Session(open_link(firmware.uri)) as session:
        session.discover(30.0)
        yield FIRMWARES[request.param], Parameters(session)


def test_every_gain_and_setting_of_every_axis_has_a_known_name(aboard: tuple[str, Parameters]) -> None:
    firmware, parameters = aboard
    assert len(FIRMWARE[firmware].axes) >= 3
    for axis in FIRMWARE[firmware].axes.values():
        required = [*(g.parameter for g in axis.gains), *axis.context]
        names, own = read_named(parameters, required)
        missing = {name for name in required if names.own(name) not in own}
        assert missing <= LATER
        assert missing <= set(axis.context)


def test_a_gain_is_written_in_the_vehicles_own_unit_and_restored(aboard: tuple[str, Parameters]) -> None:
    firmware, parameters = aboard
    assert len(FIRMWARE[firmware].axes) >= 3
    for axis in FIRMWARE[firmware].axes.values():
        names, own = read_named(parameters, [g.parameter for g in axis.gains])
        for name, value in names.to_canonical(own).items():
            required = value - 1.0 if name in WHOLE else 0.9 * value + 0.05
            parameters.write(names.own(name), names.own_value(name, required))
            again, now = read_named(parameters, [name])
            assert same_float32(again.to_canonical(now)[name], required)
            parameters.write(names.own(name), own[names.own(name)])
        assert read_named(parameters, [g.parameter for g in axis.gains])[1] == own
