"""Places, units and plots of effects of water and surroundings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from disturbance_bench import BOAT, COASTER, DIVER, HOVERER, SPINNER, Water, craft, form, levels

from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance

SLUGS = (
    "linear-drag", "quadratic-drag", "coriolis-coupling", "sway-yaw-coupling", "mass-change", "net-buoyancy",
    "ground-effect", "input-bias", "steady-current", "wind-moment", "tether-pull",
)  # fmt: skip

CRAFT = {"boat": BOAT, "spinner": SPINNER, "diver": DIVER, "hoverer": HOVERER, "coaster": COASTER}
SCENES = {n: c.data_summary(c.sail(Water())) for n, c in CRAFT.items()}


def without(data_summary: DataSummary, *signals: str) -> DataSummary:
    return replace(data_summary, signals={n: u for n, u in data_summary.signals.items() if n not in signals})


def test_the_catalogue_lists_the_effects_in_order() -> None:
    assert [s for s in EFFECTS if s in SLUGS] == list(SLUGS)


@pytest.mark.parametrize(
    ("slug", "name", "places"),
    [
        ("linear-drag", "boat", ()),
        ("quadratic-drag", "boat", ("surge", "sway", "yaw")),
        ("coriolis-coupling", "boat", ("surge+sway+yaw",)),
        ("coriolis-coupling", "spinner", ()),
        ("sway-yaw-coupling", "boat", ("sway+yaw",)),
        ("sway-yaw-coupling", "coaster", ()),
        ("mass-change", "boat", ("surge+sway+yaw",)),
        ("net-buoyancy", "diver", ("heave",)),
        ("net-buoyancy", "boat", ()),
        ("ground-effect", "diver", ("heave",)),
        ("ground-effect", "hoverer", ("yaw",)),
        ("ground-effect", "boat", ()),
        ("input-bias", "diver", ()),
        ("input-bias", "boat", ("surge", "sway", "yaw")),
        ("steady-current", "boat", ("over ground", "through water")),
        ("steady-current", "coaster", ("through water",)),
        ("steady-current", "diver", ()),
        ("wind-moment", "spinner", ("yaw",)),
        ("tether-pull", "boat", ("yaw", "surge+sway")),
        ("tether-pull", "coaster", ("surge",)),
        ("tether-pull", "diver", ("heave",)),
        ("changing-current", "boat", ("over ground", "through water")),
        ("changing-current", "diver", ()),
        ("wind-load", "boat", ("surge+sway+yaw",)),
        ("wind-load", "spinner", ()),
        ("tether-line", "boat", ("surge+sway",)),
        ("tether-line", "diver", ("heave",)),
        ("tether-line", "coaster", ()),
        ("shallow-water", "boat", ("surge+sway+yaw",)),
        ("shallow-water", "spinner", ()),
        ("bank-suction", "boat", ("sway+yaw",)),
        ("bank-suction", "diver", ()),
    ],
)
def test_each_effect_has_its_places(slug: str, name: str, places: tuple[str, ...]) -> None:
    assert EFFECTS[slug].places(SCENES[name]) == places


def test_effects_of_the_heading_need_a_measured_heading() -> None:
    assert EFFECTS["wind-moment"].places(without(SCENES["spinner"], "psi")) == ()
    assert EFFECTS["tether-pull"].places(without(SCENES["spinner"], "psi")) == ()
    assert EFFECTS["steady-current"].places(without(SCENES["boat"], "psi")) == ()


def test_positions_or_speeds_alone_allow_one_interpretation_of_a_current() -> None:
    assert EFFECTS["steady-current"].places(without(SCENES["boat"], "u", "v")) == ("over ground",)
    assert EFFECTS["steady-current"].places(without(SCENES["boat"], "x", "y")) == ("over ground",)


def test_depth_has_to_change_by_more_than_its_noise() -> None:
    assert EFFECTS["ground-effect"].places(replace(SCENES["diver"], level={"z": 10.0})) == ()


@pytest.mark.parametrize(
    ("slug", "name", "there"),
    [("quadratic-drag", "spinner", "N_rr"), ("quadratic-drag", "spinner", "N_|r|r"), ("input-bias", "spinner", "N_0"),
     ("net-buoyancy", "diver", "Z_0"), ("wind-moment", "spinner", "N_sinpsi"),
     ("wind-load", "boat", "X_cospsi"), ("tether-pull", "spinner", "N_psi"),
     ("sway-yaw-coupling", "boat", "N_v"), ("steady-current", "boat", "V_y"), ("coriolis-coupling", "boat", "N_uv")],
)  # fmt: skip
def test_terms_of_the_base_model_are_not_candidates(slug: str, name: str, there: str) -> None:
    data_summary = SCENES[name]
    before = EFFECTS[slug].places(data_summary)
    after = EFFECTS[slug].places(replace(data_summary, form=data_summary.form.freeing(there)))
    assert len(after) < len(before)


@pytest.mark.parametrize(
    ("slug", "name", "place", "units"),
    [
        ("quadratic-drag", "boat", "surge", {"coefficient": "N s^2/m^2"}),
        ("quadratic-drag", "spinner", "yaw", {"coefficient": "N m s^2/rad^2"}),
        ("linear-drag", "boat", "sway", {"coefficient": "N s/m"}),
        ("coriolis-coupling", "boat", "surge+sway+yaw", {"X_vr": "N s^2/(m rad)", "N_uv": "N m s^2/m^2"}),
        ("sway-yaw-coupling", "boat", "sway+yaw", {"Y_r": "N s/rad", "N_v": "N m s/m", "Y_rdot": "N s^2/rad"}),
        ("mass-change", "boat", "surge+sway+yaw", {"ratio": "1", "time": "s"}),
        ("net-buoyancy", "diver", "heave", {"force": "N"}),
        ("ground-effect", "diver", "heave", {"strength": "1", "length": "m"}),
        ("input-bias", "boat", "sway", {"bias": "N"}),
        ("steady-current", "boat", "over ground", {"V_x": "m/s"}),
        ("wind-moment", "spinner", "yaw", {"strength": "N m", "direction": "rad"}),
        ("tether-pull", "spinner", "yaw", {"stiffness": "N m/rad", "anchor": "rad"}),
        ("tether-pull", "boat", "surge+sway", {"stiffness": "N/m", "x": "m"}),
        ("wind-load", "boat", "surge+sway+yaw", {"X": "N", "N": "N m", "direction": "rad"}),
        ("tether-line", "boat", "surge+sway", {"stiffness": "N/m", "drag": "N s^2/m^2", "length": "m"}),
        ("shallow-water", "boat", "surge+sway+yaw", {"drag": "N s^2/m^2", "sway": "1", "north": "1/m"}),
        ("bank-suction", "boat", "sway+yaw", {"Y": "N s^2/m", "N": "N m s^2/m", "distance": "m"}),
    ],
)
def test_each_parameter_has_its_unit(slug: str, name: str, place: str, units: dict[str, str]) -> None:
    assert {n: EFFECTS[slug].unit_of(n, place, SCENES[name]) for n in units} == units


def test_units_with_normalised_thrust() -> None:
    data_summary = SCENES["spinner"]
    shares = replace(data_summary, form=replace(data_summary.form, normalised=True), inputs={"N": "1"})
    assert EFFECTS["wind-moment"].unit_of("strength", "yaw", shares) == "1"
    assert EFFECTS["quadratic-drag"].unit_of("coefficient", "yaw", shares) == "s^2/rad^2"


def reversed_rudder() -> DataSummary:
    """A boat whose positive rudder turns it to port: inertia and drag are negative in units of rudder."""
    ship = craft(("yaw",), {"r": -2.0}, {"r": -1.5}, {"delta": levels(0.4)}, {"psi": 0.0, "r": 0.0}, ("psi", "r"))
    return replace(ship.data_summary(ship.sail(Water())), form=form(("yaw",), {"N_rdot": 2.0, "N_r": 1.5}, ("delta",)))


@pytest.mark.parametrize(
    ("slug", "values", "forces"),
    [
        ("quadratic-drag", {"coefficient": 0.3}, {"N_rr": 0.3}),
        ("tether-pull", {"stiffness": 0.2, "anchor": 0.5}, {"N_psi": 0.2, "N_0": -0.1}),
        ("wind-moment", {"strength": 0.2, "direction": 0.0}, {"N_sinpsi": 0.2, "N_cospsi": 0.0}),
        ("input-bias", {"bias": 0.1}, {"N_0": 0.1}),
    ],
)
def test_drag_damps_and_a_tether_pulls_back_with_a_reversed_rudder(
    slug: str, values: dict[str, float], forces: dict[str, float]
) -> None:
    data_summary, entry = reversed_rudder(), EFFECTS[slug]
    own = EffectInstance(slug, "yaw", values, dict(entry.constants("yaw", data_summary)))
    assert entry.derivatives(own) == pytest.approx(forces)
    assert entry.unit_of(next(iter(values)), "yaw", data_summary).startswith("rad")


@pytest.mark.parametrize("name", SCENES)
def test_every_plot_has_matching_coordinates_and_axis_labels(name: str) -> None:
    data_summary, pictures = SCENES[name], 0
    for slug in SLUGS:
        entry = EFFECTS[slug]
        for place in entry.places(data_summary):
            own = EffectInstance(
                slug, place, dict(entry.starts(place, data_summary)[0]), dict(entry.constants(place, data_summary))
            )
            drawn = entry.curve(own, data_summary)
            if drawn is None:
                continue
            assert len(drawn.x) == len(drawn.y)
            assert drawn.plain is None or len(drawn.plain) == len(drawn.x)
            assert np.all(np.isfinite(drawn.y)) and np.ptp(drawn.y) > 0.0
            assert "[" in drawn.x_label and drawn.y_label and drawn.title
            pictures += 1
    assert pictures


def test_every_entry_has_a_description_and_refers_to_similar_effects() -> None:
    for slug in SLUGS:
        entry = EFFECTS[slug]
        assert slug not in entry.mistaken_for and entry.mistaken_for
        assert {q.name for q in entry.parameters} >= set(entry.grows_with)
        assert len(entry.meaning) > 30 and len(entry.shown_by) > 30 and len(entry.separated_by) > 30


def test_a_change_of_mass_does_not_change_commands() -> None:

    entry = EFFECTS["mass-change"]
    truth = SPINNER.sail(Water())
    passage = SPINNER.passage(truth)

    own = EffectInstance("mass-change", "yaw", {"ratio": 2.0, "time": 13.0})
    drive = entry.drive(own, Drive(passage.t_in, passage.commands, passage.start, passage.measured))
    assert np.all(np.diff(drive.t) > 0.0)
    assert drive.channels["payload"][drive.t < 13.0] == pytest.approx(1.0)
    assert drive.channels["payload"][drive.t >= 13.0] == pytest.approx(2.0)
    at = np.searchsorted(passage.t_in, drive.t, side="right") - 1
    assert drive.channels["N"] == pytest.approx(passage.commands["N"][at])
