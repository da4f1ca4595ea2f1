"""A row of the table: its force, the craft it suits, the names of its presets."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.manoeuvres import ManoeuvreKind, Preset, TurnAround, TurnAroundSettings

ROVER, SUB = FIRMWARE["ardurover"], FIRMWARE["ardusub"]


def row(force: str = "N", **changes: object) -> ManoeuvreKind:
    kind = ManoeuvreKind("waltz", "round and round", frozenset({"yaw"}), frozenset({force}))
    return replace(kind, **changes)  # type: ignore[arg-type]


def test_a_row_is_returned_unchanged_for_its_own_force_and_adapted_for_another() -> None:
    kind = row(for_force=row)
    assert kind.of("") is kind
    assert kind.of("N") is kind
    assert kind.of("Z").drives == {"Z"}
    both = row(drives=frozenset({"N", "X"}))
    assert both.of("") is both
    for force in ("N", "X", "Z"):
        with pytest.raises(UsageError, match=f"waltz drives N and X and does not accept --force {force}"):
            both.of(force)


@pytest.mark.parametrize(
    ("kind", "boat", "rov"),
    [
        (row(), True, True),
        (row("Z"), False, True),
        (row(drives=frozenset({"N", "Z"})), False, True),
        (row(drives=frozenset()), True, True),
        (row(needs_way=True), True, False),
        (row(stays=True), False, True),
        (row(axis="heading"), True, True),
        (row(axis="depth"), False, True),
        (row(axis="speed"), True, False),
        (row("Z", needs_way=True), False, False),
    ],
)
def test_a_manoeuvre_suits_a_craft_with_the_required_forces_and_motion(
    kind: ManoeuvreKind, boat: bool, rov: bool
) -> None:
    assert (kind.suits(ROVER), kind.suits(SUB)) == (boat, rov)


def test_fields_of_a_row_default_to_empty() -> None:
    kind = row()
    assert kind.identifies
    assert not (kind.turns or kind.needs_way or kind.stays or kind.tied)
    assert (kind.make, kind.needs, kind.axis, kind.command, kind.presets, kind.shrinks) == (None, "", "", "fly", (), {})


def test_a_preset_name_is_its_plain_title_and_it_drives_its_forces() -> None:
    def about(seconds: float) -> TurnAround:
        return TurnAround(TurnAroundSettings(0.5))

    preset = Preset("zig-zag 20/20, at 60 % throttle %", "X N", about)
    assert preset.name == "zig-zag-20-20-at-60-throttle"
    assert preset.drives == {"X", "N"}
    assert not preset.closed
    assert Preset("ahead", "X", about).drives == {"X"}
    assert math.isnan(preset.make(1.0).target)
