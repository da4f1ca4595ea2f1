"""Every standard manoeuvre of the table, flown by a simulated craft: its figures match that craft."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.limits import limit_of
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, NominalPlant, preview
from gcs_autotune.models import SingleDof
from gcs_autotune.seatrials import MANOEUVRES as FIGURES
from gcs_autotune.seatrials import Particulars, Sheet, ship_figures
from gcs_autotune.trial import Trial

DEG = math.pi / 180.0
ALPHA, BETA, BIAS = 1.5, 2.0, 0.01
"""The craft: turns at 0.5 rad/s at full steering with a lag of 0.75 s, and a little to starboard by itself."""
DRAG, MASS = 1.0, 4.0
CRAFT = NominalPlant(
    SingleDof("yaw", "1", ALPHA, BETA, delta=BIAS),
    1.0,
    "a test",
    others={"X": SingleDof("surge", "1", MASS, 0.0, DRAG)},
)
FREE = Envelope(heading_excursion=math.inf, time=3600.0, distance=3600.0)
SPEED = math.sqrt(0.64 / DRAG)


def flown(name: str, **more: float) -> Trial:
    kind = MANOEUVRES[name]
    assert kind.make is not None
    rows = {n: limit_of(n, kind.axis) for n in kind.options}
    usual = {n: row.default * row.factor for n, row in rows.items() if row.default is not None}
    given = {"steering": 0.5, "side": 1.0, "throttle": 0.64, "keep-still": 0.0, "full-rudder": 30.0 * DEG, **more}
    seen = preview(kind.make({**usual, **given}), CRAFT, FREE)
    assert seen.trouble == ""
    return seen.trial


def sheets(name: str, **more: float) -> dict[str, Sheet]:
    return {s.manoeuvre: s for s in ship_figures(flown(name, **more), Particulars(length=0.5))}


def value(sheet: Sheet, slug: str) -> float:
    return sheet[slug].reading.value


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turning_circle_to_either_side_has_the_crafts_rate_and_diameter(side: float) -> None:
    both = sheets("turning-circle", side=side)
    circle, rate = both["turning-circle"], (side * 0.5 + BIAS) / BETA
    assert circle.title.endswith("starboard" if side > 0.0 else "port")
    assert value(circle, "helm") == pytest.approx(15.0 * DEG, rel=1e-3)
    assert value(circle, "rate") == pytest.approx(rate, rel=1e-3)
    assert value(circle, "steady-diameter") == pytest.approx(2.0 * SPEED / abs(rate), rel=0.01)
    assert value(circle, "tactical-diameter-lengths") == pytest.approx(value(circle, "tactical-diameter") / 0.5)
    assert circle["tactical-diameter-lengths"].verdict == "open"
    assert value(both["pull-out"], f"after-{'starboard' if side > 0.0 else 'port'}") == pytest.approx(
        BIAS / BETA, abs=2e-4
    )


def test_pull_outs_to_both_sides_distinguish_trim_from_instability() -> None:
    sheet = sheets("pull-out")["pull-out"]
    assert value(sheet, "offset") == pytest.approx(BIAS / BETA, abs=1e-4)
    assert value(sheet, "residual-rate") == pytest.approx(0.0, abs=1e-4)
    assert "directionally stable" in sheet.verdict


@pytest.mark.parametrize("name", ["spiral", "reverse-spiral"])
def test_a_spiral_of_a_stable_craft_has_its_slope(name: str) -> None:
    sheet = sheets(name)[name]
    assert sheet["slope"].name == "yaw rate per helm, at amidships"
    assert value(sheet, "slope") == pytest.approx(1.0 / BETA / (30.0 * DEG), rel=0.01)
    assert "directionally stable" in sheet.verdict
    helms = sorted({round(float(f.name.split("helm ")[1].split(",")[0])) for f in sheet.figures if "point" in f.slug})
    shift = 0 if name == "spiral" else 0.3  # a rate of k/3 that of the first turn takes a helm less by the trim
    assert helms == pytest.approx([-15, -10, -5, 0, 5, 10, 15], abs=1.0 + shift)


def test_stopping_distance_and_time_match_quadratic_drag() -> None:
    coast, astern = (sheets("stopping", astern=a)["stopping"] for a in (0.0, 1.0))
    speed = value(coast, "approach")
    assert speed == pytest.approx(SPEED, rel=0.05)  # by then it still gains a little
    lag = MASS / (DRAG * speed)
    assert value(coast, "time-half") == pytest.approx(lag, rel=0.03)
    assert value(coast, "reach-half") == pytest.approx(MASS / DRAG * math.log(2.0), rel=0.03)
    assert value(coast, "track-reach") == pytest.approx(MASS / DRAG * math.log(10.0), rel=0.03)
    assert coast["track-reach-lengths"].limit is None
    reach = 0.5 * MASS / DRAG * math.log((1.0 + speed**2) / (1.0 + 0.01 * speed**2))
    assert value(astern, "track-reach") == pytest.approx(reach, rel=0.03)
    assert value(astern, "head-reach") == pytest.approx(reach, rel=0.03)
    assert astern["track-reach-lengths"].verdict == "meets"


def test_an_incomplete_stop_has_a_doubt_and_keeps_its_other_figures() -> None:
    run = flown("stopping", astern=0.0)
    sheet = ship_figures(run.between(run.start, run.end - 25.0))[0]
    assert [d.slug for d in sheet.doubts] == ["not-stopped"]
    assert value(sheet, "time-half") > 0.0
    with pytest.raises(KeyError):
        sheet["track-reach"]


def test_every_manoeuvre_with_figures_can_be_flown_by_its_name() -> None:
    assert set(FIGURES) <= set(MANOEUVRES)


def test_a_stop_that_ends_before_the_thrust_settles_has_its_figures() -> None:
    run = flown("stopping", astern=0.5)
    (order,) = [m.t for m in run.marks if m.kind == "execute"]
    X = run["X"]
    slewed = np.where(X.t > order, 0.64 - 0.8 * (X.t - order), X.values)
    end = order + 1.5
    short = replace(run, channels={**run.channels, "X": replace(X, values=slewed)}).between(run.start, end)
    u = short["u"]
    quick = np.where(u.t > order, SPEED * (1.0 - (u.t - order) / 1.4), u.values)
    (sheet,) = ship_figures(replace(short, channels={**short.channels, "u": replace(u, values=quick)}))
    assert value(sheet, "time-stop") == pytest.approx(0.9 * 1.4, abs=0.1)
    assert "astern" in sheet.title


def test_the_diagrams_mark_what_the_tables_state() -> None:
    circle = sheets("turning-circle")["turning-circle"]
    assert circle.shape is not None
    at_90, at_180 = circle.shape.points
    assert at_90[1:] == (value(circle, "transfer"), value(circle, "advance"))
    assert at_180[1] == value(circle, "tactical-diameter")
    _, abeam, ahead = circle.shape.lines[0]
    for _, x, y in circle.shape.points:
        assert float(np.min(np.hypot(abeam - x, ahead - y))) < 0.02 * value(circle, "tactical-diameter")
    stop = sheets("stopping")["stopping"]
    assert stop.shape is not None
    assert stop.shape.points[0][2] == value(stop, "head-reach")
    spiral = sheets("spiral")["spiral"]
    assert spiral.shape is not None
    drawn = sum(len(rate) for _, _, rate in spiral.shape.lines)
    assert drawn == sum(figure.slug.startswith("point-") for figure in spiral.figures)
