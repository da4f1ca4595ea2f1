"""Axes are defined in one table; the abilities of a craft follow from its firmware, never from its kind."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import pytest

import gcs_autotune
from gcs_autotune.axes import AXES, OTHER_NAMES, axis_kind
from gcs_autotune.cli import make_parser
from gcs_autotune.cli.tune_cmd import ALL
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.limits import LIMITS
from gcs_autotune.tunables import TUNABLES

PACKAGE = Path(gcs_autotune.__file__).parent


def choices(command: str) -> set[str]:
    verbs = next(a for a in make_parser()._actions if isinstance(a, argparse._SubParsersAction))
    return set(next(a.choices for a in verbs.choices[command]._actions if a.dest == "axis"))


def test_only_the_firmware_package_checks_the_kind_of_craft() -> None:
    asking = re.compile(r"\bkind\s*(==|!=)\s*\"(boat|rov)\"|\bkind in \(\"(boat|rov)")
    found = [p for p in PACKAGE.rglob("*.py") if "firmware" not in p.parts and asking.search(p.read_text("utf-8"))]
    assert found == []
    assert asking.search('if craft.firmware.kind == "boat":')


def test_every_command_has_the_same_axis_names() -> None:
    assert choices("tune") == {*AXES, *TUNABLES, ALL}
    assert choices("experiment") == set(AXES) | set(OTHER_NAMES)


@pytest.mark.parametrize("firmware", FIRMWARE.values(), ids=list(FIRMWARE))
def test_every_loop_of_a_firmware_is_an_axis_of_the_table_with_the_same_motion(firmware) -> None:
    assert firmware.axes
    for name, loop in firmware.axes.items():
        assert axis_kind(name).dof == loop.dof
        assert loop.needs_speed <= firmware.needs_way


@pytest.mark.parametrize("name", [*AXES, *OTHER_NAMES])
def test_every_axis_has_a_hysteresis_range_in_its_own_unit(name: str) -> None:
    assert (LIMITS["relay-hysteresis", name].unit == "deg") is axis_kind(name).angular
