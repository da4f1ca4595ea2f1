"""The family of hydrodynamic terms: made systematically, one list for forms and for causes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.effects import (
    EFFECTS,
    DataSummary,
    EffectInstance,
    ExtendedModel,
    name_of,
    passage_of,
    product_terms,
    term_named,
    twins_of,
)
from gcs_autotune.models import FORMS, STATES, CoupledModel, Form, inertia_of
from gcs_autotune.trial import Channel

PLANE = {"X": 7, "Y": 12, "N": 12}
"""Terms in surge, sway and yaw up to the second order."""


def summary(
    dofs: tuple[str, ...],
    free: tuple[str, ...] = (),
    *,
    astern: float = 0.0,
    measured: str = "uvr",
    inertia: float = 1.0,
) -> DataSummary:
    forces = {"surge": "X", "sway": "Y", "yaw": "N"}
    letters = {"surge": "u", "sway": "v", "yaw": "r"}
    base = {f"{forces[d]}_{letters[d]}dot": -inertia for d in dofs} | {f"{forces[d]}_{letters[d]}": -1.0 for d in dofs}
    inputs = {forces[d]: ((forces[d], 1.0),) for d in dofs}
    form = Form("plain", "plain", dofs, (*base, *free), {}, inputs, coriolis=False)
    return DataSummary(
        form,
        inputs=dict.fromkeys(inputs, "1"),
        signals={},
        amplitude=dict.fromkeys(inputs, 2.0),
        spread={},
        level={},
        channels=frozenset(measured),
        interval=0.1,
        time_constant=1.0,
        duration=60.0,
        extent={"u": (astern, 2.0), "v": (-0.5, 0.5), "r": (-1.0, 1.0)},
        base=base,
    )


def places(data: DataSummary) -> dict[str, tuple[str, ...]]:
    return {e.slug: e.places(data) for e in EFFECTS.values() if e.family == "hydrodynamics" and e.is_structural}


def test_rows_contain_every_product_of_one_or_two_velocities_allowed_by_symmetry() -> None:
    terms = list(product_terms("uvr"))
    assert {row: sum(t.row == row for t in terms) for row in PLANE} == PLANE
    assert len({t.code for t in terms}) == len(terms)


def test_products_of_third_order_are_made_on_request() -> None:
    more = {t.derivative for t in product_terms("uvr", order=3)} - {t.derivative for t in product_terms("uvr")}
    assert {"N_vvv", "N_|v||v|r", "N_|r||r|v", "N_rrr", "X_uvr", "Y_|u||u|v"} <= more
    assert all(len(term_named(name).factors) == 3 for name in more)


def test_every_term_has_a_description_and_a_source() -> None:
    bibliography = (Path(__file__).parents[2] / "docs" / "references.bib").read_text(encoding="utf-8")
    keys = set(re.findall(r"^@\w+\{(\w+),", bibliography, re.MULTILINE))
    terms = list(product_terms(order=3))
    assert len(terms) > 30
    for term in terms:
        assert term.words and term.source in keys


def test_products_of_forms_and_of_causes_are_one_list() -> None:
    for form in FORMS.values():
        products = [n for n in form.free if re.fullmatch(r"[XYZKMN]_[uvwpqr|]+", n) and inertia_of(n) is None]
        for name in products:
            assert {s for s, _ in term_named(name).factors} <= set(STATES)
    assert term_named("N_rr") is term_named("N_|r|r")
    with pytest.raises(KeyError):
        term_named("N_u|w|")


@pytest.mark.parametrize("dofs", [("yaw",), ("surge",), ("surge", "yaw"), ("sway", "yaw"), ("surge", "sway", "yaw")])
def test_each_term_of_a_model_is_searched_under_one_name(dofs: tuple[str, ...]) -> None:
    """Drags, couplings, named terms and products together: every term once, none that the model has."""
    data = summary(dofs, astern=-2.0)
    borne: list[str] = []
    for slug, found in places(data).items():
        entry = EFFECTS[slug]
        for place in found:
            if slug == "velocity-product":
                borne.append(place)
            else:
                names = entry.derivatives(
                    EffectInstance(
                        slug, place, {q.name: 1.0 for q in entry.parameters}, {"simulated_u": 1.0, "simulated_v": 1.0}
                    )
                )
                borne += [n for n in names if not n.endswith("dot")]
    codes = [term_named(n).code for n in borne]
    assert len(set(codes)) == len(codes)
    rows = {"surge": "X", "sway": "Y", "yaw": "N"}
    wanted = {t.code for t in product_terms("uvr") if t.row in {rows[d] for d in dofs}}
    base = {term_named(n).code for n in data.form.free if not n.endswith("dot")}
    assert set(codes) == wanted - base


def test_equivalent_terms_have_one_name_for_a_craft_never_recorded_astern() -> None:
    ahead, both = summary(("yaw",)), summary(("yaw",), astern=-2.0)
    assert "N_ur" not in places(ahead)["velocity-product"]
    assert "N_ur" in places(both)["velocity-product"]
    damping = EffectInstance("speed-damping", "yaw", {"N_|u|r": -1.0})
    assert twins_of(damping, ahead) == ("N_ur",)
    assert twins_of(damping, both) == ()


def test_damping_terms_only_damp_for_either_sign_of_the_inertia() -> None:
    entry = EFFECTS["speed-damping"]
    assert entry.bounds("yaw", summary(("yaw",)))["N_|u|r"][1] == 0.0
    assert entry.bounds("yaw", summary(("yaw",), inertia=-1.0))["N_|u|r"][0] == 0.0
    assert EFFECTS["velocity-product"].bounds("N_|v|v", summary(("yaw",)))["coefficient"] == (-np.inf, np.inf)


def test_a_simulated_and_a_measured_velocity_give_the_same_force() -> None:
    t = np.arange(0.0, 20.0, 0.05)
    values = {"X_udot": -4.0, "X_u": -2.0, "N_rdot": -1.0, "N_r": -0.5}
    inputs = {"X": (("X", 1.0),), "N": (("N", 1.0),)}
    both = CoupledModel(Form("both", "both", ("surge", "yaw"), tuple(values), {}, inputs, coriolis=False), values)
    commands = {"X": 3.0 * np.sign(np.sin(0.3 * t)), "N": np.sign(np.sin(0.9 * t))}
    start = {"u": 0.0, "r": 0.0}
    own = EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.8}, {"simulated_u": 1.0})
    stamps = dict.fromkeys(("u", "r"), t)
    true = ExtendedModel(both, (own,)).predict(passage_of("run", t, commands, stamps), start)
    assert true is not None
    yaw = {n: v for n, v in values.items() if n[0] == "N"}
    alone = CoupledModel(Form("yaw", "yaw", ("yaw",), tuple(yaw), {}, {"N": inputs["N"]}, coriolis=False), yaw)
    seen = {"u": Channel("u", "m/s", t, true["u"])}
    passage = passage_of("run", t, {"N": commands["N"]}, {"r": t}, seen)
    found = ExtendedModel(alone, (EffectInstance("speed-damping", "yaw", own.values),)).predict(passage, start)
    assert found is not None
    assert np.max(np.abs(found["r"] - true["r"])) < 2e-3 * np.ptp(true["r"])


@pytest.mark.parametrize("inertia", [1.0, -1.0])
@pytest.mark.parametrize("slug", ["speed-damping", "munk-moment"])
def test_the_description_of_a_product_moment_is_true_for_either_sign(slug: str, inertia: float) -> None:
    """A turn to starboard at 2 m/s, in which the craft slides to port."""
    t = np.arange(0.0, 20.0, 0.05)
    values = {"N_rdot": -inertia, "N_r": -0.5 * inertia}
    base = CoupledModel(Form("yaw", "yaw", ("yaw",), tuple(values), {}, {"N": (("N", 1.0),)}, coriolis=False), values)
    still = {n: Channel(n, "m/s", t, np.full_like(t, v)) for n, v in (("u", 2.0), ("v", -0.5))}
    passage = passage_of("run", t, {"N": np.full_like(t, inertia)}, {"r": t}, still)

    def rate(value: float) -> float:
        (name,) = EFFECTS[slug].grows_with
        own = (EffectInstance(slug, "yaw", {name: value}),) if value else ()
        found = ExtendedModel(base, own).predict(passage, {"r": 0.0})
        assert found is not None
        return float(found["r"][-1])

    plain, opposite, same = rate(0.0), rate(-0.2 * inertia), rate(0.2 * inertia)
    entry = EFFECTS[slug]
    if slug == "munk-moment":
        assert opposite > plain > same > 0.0
        assert "Opposite in sign to the inertia, it turns the craft further" in entry.parameters[0].meaning
        assert "further into a turn or out of it" in entry.meaning and "further" not in entry.plain
    else:  # the other sign would drive the turn, and is not fitted
        low, high = entry.bounds("yaw", summary(("yaw",), inertia=inertia))["N_|u|r"]
        assert low <= -0.2 * inertia <= high and not low <= 0.2 * inertia <= high
        assert plain > opposite > 0.0
        assert "harder" in entry.meaning and "grows with speed" in entry.plain


def test_causes_are_called_by_slug_or_else_by_their_derivative() -> None:
    assert name_of(EffectInstance("sway-moment", "yaw", {})) == "sway-moment"
    assert name_of(EffectInstance("velocity-product", "N_|v|r", {})) == "N_|v|r"


def test_a_model_file_with_the_old_signed_speed_damping_is_converted() -> None:
    values = {"N_rdot": -1.0, "N_r": -0.5}
    base = CoupledModel(Form("yaw", "yaw", ("yaw",), tuple(values), {}, {"N": (("N", 1.0),)}, coriolis=False), values)
    document = ExtendedModel(base, (EffectInstance("speed-damping", "yaw", {"N_|u|r": -0.3}),)).to_dict()
    document["effects"][0]["values"] = {"N_ur": -0.3}
    (read,) = ExtendedModel.from_dict(document).effects
    assert (read.slug, read.place, read["coefficient"]) == ("velocity-product", "N_ur", -0.3)
