"""A user's manoeuvre is one class and one row; it is listed, previewed and flown like the others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from gcs_autotune.cli import main
from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    Commands,
    Envelope,
    Manoeuvre,
    ManoeuvreKind,
    NominalPlant,
    Sequencer,
    preview,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver

from .toy_craft import PondCraft


class Wiggle(Manoeuvre):
    kind = "wiggle"

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.seconds = seconds

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        return {"dof": "yaw", "force": "N"}

    def commands(self, now: Observation) -> Commands:
        start = now.t
        while True:
            if now.t - start > self.seconds:
                self._end("completed", "wiggled")
            now = yield Actuate(N=0.3 if int(now.t) % 2 else -0.3)


KIND = ManoeuvreKind(
    "wiggle",
    "left and right",
    excites=frozenset({"yaw"}),
    drives=frozenset({"N"}),
    make=lambda options: Wiggle(options["duration"]),
    options=("duration",),
)


@pytest.mark.slow
def test_a_manoeuvre_added_to_the_table_is_listed_previewed_and_flown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Any
) -> None:
    monkeypatch.setitem(MANOEUVRES, "wiggle", KIND)  # type: ignore[arg-type]
    assert main(["fly", "--list"]) == 0
    assert "wiggle\n    left and right. Excites yaw." in capsys.readouterr().out
    out = tmp_path / "run"
    assert main(["fly", "wiggle", "--duration", "8", "--connect", "sitl:videoray", "--out", str(out), "--yes"]) == 0
    assert "Report:" in capsys.readouterr().out
    assert (out / "trials" / "02-wiggle.csv").exists()
    paper = NominalPlant(SingleDof("yaw", "1", 1.0, 1.0), 0.0, "a test")
    assert preview(Wiggle(8.0), paper, Envelope()).seconds == pytest.approx(8.1, abs=0.1)


def test_the_sequencer_only_needs_the_generator() -> None:
    free = Envelope(heading_excursion=math.inf)
    flown = Sequencer(PondCraft(), free, SilentObserver(), lambda trial: None).fly(Wiggle(5.0))
    assert flown.reason == "wiggled"
    assert flown.meta["manoeuvre"] == "wiggle"
    assert flown.purpose == "identification"
