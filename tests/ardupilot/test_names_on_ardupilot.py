"""Parameter names and scales on an unmodified ArduSub and ArduRover: asked for, written and read back, put back."""

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
"""New in 4.7; the design does without, as the firmware before it did."""
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


def test_every_gain_and_setting_of_every_axis_is_found_under_some_name(aboard: tuple[str, Parameters]) -> None:
    firmware, parameters = aboard
    assert len(FIRMWARE[firmware].axes) >= 3
    for axis in FIRMWARE[firmware].axes.values():
        wanted = [*(g.parameter for g in axis.gains), *axis.context]
        names, own = read_named(parameters, wanted)
        missing = {name for name in wanted if names.own(name) not in own}
        assert missing <= LATER
        assert missing <= set(axis.context)


def test_a_gain_is_written_in_the_vehicle_s_own_unit_and_put_back(aboard: tuple[str, Parameters]) -> None:
    firmware, parameters = aboard
    assert len(FIRMWARE[firmware].axes) >= 3
    for axis in FIRMWARE[firmware].axes.values():
        names, own = read_named(parameters, [g.parameter for g in axis.gains])
        for name, value in names.to_canonical(own).items():
            wanted = value - 1.0 if name in WHOLE else 0.9 * value + 0.05
            parameters.write(names.own(name), names.own_value(name, wanted))
            again, now = read_named(parameters, [name])
            assert same_float32(again.to_canonical(now)[name], wanted)
            parameters.write(names.own(name), own[names.own(name)])
        assert read_named(parameters, [g.parameter for g in axis.gains])[1] == own
