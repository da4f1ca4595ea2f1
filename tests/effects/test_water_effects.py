"""Effects of water and surroundings: the law against SciPy, sensitivities, and sizes found again from every file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from disturbance_bench import BOAT, COASTER, DIVER, HOVERER, SLIPPERY, SPINNER, T_OUT, Craft, Fit, Water

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, ExtendedModel, ExtendedSimulator

TURN = np.pi


def toward(x: float, y: float, k: float, s: Mapping[str, float]) -> dict[str, float]:
    """Return a spring's pull to a place on the plane in the body frame."""
    north, east = k * (x - s["x"]), k * (y - s["y"])
    c, n = np.cos(s["psi"]), np.sin(s["psi"])
    return {"X": c * north + n * east, "Y": c * east - n * north}


def blown(t: float, s: Mapping[str, float], held: object) -> dict[str, float]:
    """Return the force of a wind towards 0.7 rad."""
    a = 0.7 - s["psi"]
    return {"X": 3.0 * np.cos(a), "Y": 5.0 * np.sin(a), "N": -1.2 * np.sin(2.0 * a)}


def beside(t: float, s: Mapping[str, float], held: object) -> dict[str, float]:
    """Return the forces of a wall 12 m from the origin towards 0.7 rad."""
    gap = 12.0 - s["x"] * np.cos(0.7) - s["y"] * np.sin(0.7)
    abeam = np.sin(0.7 - s["psi"]) / gap
    return {"Y": 15.0 * s["u"] ** 2 * abeam, "N": -3.0 * s["u"] * abs(s["u"]) * abeam}


def near(s: float, bottom: float, strength: float, length: float) -> float:
    return float(strength * np.exp(-(bottom - s) / length))


@dataclass(frozen=True)
class Case:
    slug: str
    place: str
    craft: Craft
    values: Mapping[str, float]
    water: Water
    constants: Mapping[str, float] | None = None


def _mass(t: float) -> float:
    return 0.6 if t >= 17.3 else 1.0


def _heavier(t: float) -> float:
    return 1.8 if t >= 9.1 else 1.0


CASES = {
    "linear drag": Case(
        "linear-drag", "yaw", SLIPPERY, {"coefficient": 0.9}, Water(lambda t, s, h: {"N": -0.9 * s["r"]})
    ),
    "quadratic drag in yaw": Case(
        "quadratic-drag", "yaw", SPINNER, {"coefficient": 1.2},
        Water(lambda t, s, h: {"N": -1.2 * abs(s["r"]) * s["r"]}),
    ),
    "quadratic drag in sway": Case(
        "quadratic-drag", "sway", BOAT, {"coefficient": 40.0},
        Water(lambda t, s, h: {"Y": -40.0 * abs(s["v"]) * s["v"]}),
    ),
    "Coriolis": Case(
        "coriolis-coupling", "surge+sway+yaw", BOAT, {"X_vr": 9.0, "Y_ur": -6.0, "N_uv": -2.0},
        Water(lambda t, s, h: {"X": 9 * s["v"] * s["r"], "Y": -6 * s["u"] * s["r"], "N": -2 * s["u"] * s["v"]}),
    ),
    "sway and yaw": Case(
        "sway-yaw-coupling", "sway+yaw", BOAT, {"Y_r": -4.0, "N_v": 3.0, "Y_rdot": -5.0},
        Water(lambda t, s, h: {"Y": -4.0 * s["r"], "N": 3.0 * s["v"]}, Y_rdot=-5.0),
    ),
    "payload dropped": Case(
        "mass-change", "yaw", SPINNER, {"ratio": 0.6, "time": 17.3}, Water(payload=_mass, jumps=(17.3,))
    ),
    "payload taken aboard": Case(
        "mass-change", "surge+sway+yaw", BOAT, {"ratio": 1.8, "time": 9.1}, Water(payload=_heavier, jumps=(9.1,))
    ),
    "too heavy": Case("net-buoyancy", "heave", DIVER, {"force": 0.7}, Water(lambda t, s, h: {"Z": 0.7})),
    "bottom under a diver": Case(
        "ground-effect", "heave", DIVER, {"strength": 2.5, "length": 0.8},
        Water(lambda t, s, h: {"Z": -9.0 * s["w"] * near(s["z"], 7.5, 2.5, 0.8)}), {"bottom": 7.5, "dives": 1.0},
    ),
    "bottom under a craft that turns": Case(
        "ground-effect", "yaw", HOVERER, {"strength": 3.0, "length": 0.7},
        Water(lambda t, s, h: {"N": -1.5 * s["r"] * near(8.0 - 1.5 * np.cos(0.25 * t), 9.5, 3.0, 0.7)}),
        {"bottom": 9.5, "dives": 0.0},
    ),
    "bias": Case("input-bias", "sway", BOAT, {"bias": 2.0}, Water(lambda t, s, h: {"Y": 2.0})),
    "current over ground": Case(
        "steady-current", "over ground", BOAT, {"V_x": 0.25, "V_y": -0.15}, Water(V=(0.25, -0.15))
    ),
    "current through water": Case(
        "steady-current", "through water", BOAT, {"V_x": 0.25, "V_y": -0.15}, Water(V=(0.25, -0.15), seen=False)
    ),
    "current along a line": Case(
        "steady-current", "through water", COASTER, {"V_x": -0.2}, Water(V=(-0.2, 0.0), seen=False)
    ),
    "wind": Case(
        "wind-moment", "yaw", SPINNER, {"strength": 0.8, "direction": -2.2},
        Water(lambda t, s, h: {"N": 0.8 * np.sin(-2.2 - s["psi"])}),
    ),
    "wind on the superstructure": Case(
        "wind-load", "surge+sway+yaw", BOAT, {"X": 3.0, "Y": 5.0, "N": 1.2, "direction": 0.7}, Water(blown)
    ),
    "wall": Case(
        "bank-suction", "sway+yaw", BOAT, {"direction": 0.7, "distance": 12.0, "Y": 15.0, "N": 3.0}, Water(beside)
    ),
    "tether that untwists": Case(
        "tether-pull", "yaw", SPINNER, {"stiffness": 0.3, "anchor": 1.5},
        Water(lambda t, s, h: {"N": -0.3 * (s["psi"] - 1.5)}),
    ),
    "tether up": Case(
        "tether-pull", "heave", DIVER, {"stiffness": 0.9, "anchor": 6.5},
        Water(lambda t, s, h: {"Z": -0.9 * (s["z"] - 6.5)}),
    ),
    "tether astern": Case(
        "tether-pull", "surge", COASTER, {"stiffness": 0.8, "anchor": 1.0},
        Water(lambda t, s, h: {"X": -0.8 * (s["x"] - 1)}),
    ),
    "tether on the plane": Case(
        "tether-pull", "surge+sway", BOAT, {"stiffness": 0.8, "x": 4.0, "y": 3.0},
        Water(lambda t, s, h: toward(4.0, 3.0, 0.8, s)),
    ),
}  # fmt: skip


@pytest.fixture(params=CASES, ids=lambda n: n.replace(" ", "-"))
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


_SAILED: dict[int, dict[str, np.ndarray]] = {}


def sailed(case: Case) -> dict[str, np.ndarray]:
    if id(case) not in _SAILED:
        _SAILED[id(case)] = case.craft.sail(case.water)
    return _SAILED[id(case)]


def applied(case: Case, data_summary: DataSummary) -> EffectInstance:
    found = dict(EFFECTS[case.slug].constants(case.place, data_summary))
    return EffectInstance(case.slug, case.place, dict(case.values), {**found, **(case.constants or {})})


def test_each_effect_matches_equations_written_out(case: Case) -> None:
    truth = sailed(case)
    own = applied(case, case.craft.data_summary(truth))
    found = ExtendedModel(case.craft.model(), (own,)).predict(case.craft.passage(truth), case.craft.start)
    assert found is not None
    plain = case.craft.sail(Water())
    for name in case.craft.measured:
        size = np.abs(plain[name] - truth[name]).max()
        assert found[name] == pytest.approx(truth[name], abs=2e-4 + 2e-3 * size), name
    assert max(np.abs(plain[n] - truth[n]).max() / np.std(truth[n]) for n in case.craft.measured) > 0.05


def test_each_effect_has_starts_within_bounds_and_zero_size_has_no_effect(case: Case) -> None:
    truth, entry = sailed(case), EFFECTS[case.slug]
    data_summary, passage = case.craft.data_summary(truth), case.craft.passage(truth)
    assert case.place in entry.places(data_summary)
    bounds = entry.bounds(case.place, data_summary)
    for start in entry.starts(case.place, data_summary):
        assert set(start) == set(case.values)
        for name, value in start.items():
            low, high = bounds.get(name, (-np.inf, np.inf))
            assert low <= value <= high, name
    nothing = {**case.values, **dict.fromkeys(entry.grows_with, 0.0)}
    if case.slug == "mass-change":
        nothing["ratio"] = 1.0
    plain = ExtendedModel(case.craft.model()).predict(passage, case.craft.start)
    same = ExtendedModel(case.craft.model(), (replace(applied(case, data_summary), values=nothing),))
    found = same.predict(passage, case.craft.start)
    assert plain is not None and found is not None
    for name, values in plain.items():  # what is linear is simulated exactly, the same with a term of no size in steps
        assert found[name] == pytest.approx(values, abs=1e-5)


def test_sensitivities_match_difference_quotients(case: Case) -> None:
    truth = sailed(case)
    own, passage = applied(case, case.craft.data_summary(truth)), case.craft.passage(truth)
    model = case.craft.model()
    names = [(0, n) for n in own.values]
    typical = [max(abs(v), 0.1) for v in own.values.values()]
    simulator = ExtendedSimulator(model.form, (own,), model.form.free, names, (), typical)
    x_0 = np.array([case.craft.start[n] for n in simulator.states])
    exact = simulator.run(model.theta, (own,), x_0, passage, sensitivities=True)
    assert exact is not None
    for j, (name, size) in enumerate(zip(own.values, typical, strict=True), len(model.form.free)):
        sides = [own.with_values({name: own[name] + s * 1e-3 * size}) for s in (1.0, -1.0)]
        up, down = (simulator.run(model.theta, (o,), x_0, passage) for o in sides)
        assert up is not None and down is not None
        for signal, (_, by) in exact.items():
            quotient = (up[signal][0] - down[signal][0]) / (2e-3 * size)
            assert by[:, j] == pytest.approx(quotient, abs=2e-2 * np.abs(quotient).max() + 1e-6), (name, signal)


@pytest.mark.slow
def test_the_size_is_identified_from_the_most_promising_starts(case: Case) -> None:
    """Base parameters, initial states and the effect fitted together to a run with a little noise."""
    truth, entry, craft = sailed(case), EFFECTS[case.slug], case.craft
    data_summary, rng = craft.data_summary(truth), np.random.default_rng(1)
    levels = {n: 2e-3 * float(np.std(truth[n])) for n in craft.measured}
    noisy = {n: truth[n] + rng.normal(0.0, levels[n], len(T_OUT)) for n in craft.measured}
    plain = Fit(craft, (), noisy, levels, {})
    before, enough = plain.run(), 1.3 * len(T_OUT) * len(noisy)
    bounds, own = entry.bounds(case.place, data_summary), applied(case, data_summary)
    starts = [replace(own, values=dict(start)) for start in entry.starts(case.place, data_summary)]
    tries = [Fit(craft, (start,), noisy, levels, bounds, plain.x) for start in starts]
    promises = [fit.promise() for fit in tries]
    likely = [i for i in np.argsort(promises)[:3].tolist() if np.isfinite(promises[i])]
    costs = [(tries[i].run(), i) for i in likely]
    after, i = min(costs)
    assert after < enough < before
    for name, value in tries[i].values().items():
        turn = 2.0 * np.pi if name == "direction" else np.inf
        error = abs(value - case.values[name])
        assert min(error, abs(turn - error)) < 0.05 * abs(case.values[name]) + 0.02, (name, value)


# -- the track under waves that turn the craft


WAVY = BOAT.sail(Water(lambda t, s, held: {"N": 4.0 * np.sin(1.5 * t)}))


def steered(place: str) -> tuple[ExtendedSimulator, tuple[EffectInstance, ...], np.ndarray, np.ndarray]:
    """Return a simulator of the boat with known waves at *place*, its parameters and its initial state."""
    wave = EffectInstance(
        "wave-disturbance", place, {"frequency": 1.5, "bandwidth": 0.01}, {"filter": 1.0, "ratio psi": 4.0}
    )
    simulator = ExtendedSimulator(BOAT.form, (wave,), BOAT.form.free, (), ("x", "y", "psi", "u", "v", "r"))
    return simulator, (wave,), BOAT.model().theta, np.array([BOAT.start[n] for n in simulator.states])


def test_the_track_follows_the_heading_to_which_waves_turn_the_craft() -> None:
    passage, errors = BOAT.passage(WAVY), {}
    for place in ("yaw", "surge"):
        simulator, waves, theta, x_0 = steered(place)
        ran = simulator.run(theta, waves, x_0, passage)
        assert ran is not None
        errors[place] = max(float(np.abs(ran[n][0] - WAVY[n]).max()) for n in ("x", "y"))
    assert errors["surge"] > 1.0  # waves ahead do not turn the craft, so its track stays the simulated one
    assert errors["yaw"] < 0.02


def test_the_turned_track_has_consistent_sensitivities() -> None:
    simulator, waves, theta, x_0 = steered("yaw")
    passage = BOAT.passage(WAVY)
    ran = simulator.run(theta, waves, x_0, passage, sensitivities=True)
    assert ran is not None
    both, first = np.concatenate([theta, x_0]), len(theta)
    for k in range(len(both)):
        h = 1e-4 * max(abs(both[k]), 0.1)
        ends = [
            simulator.run(p[:first], waves, p[first:], passage) for p in (both + h * (np.arange(len(both)) == k), both)
        ]
        column = k if k < first else first + ("x", "y", "psi", "u", "v", "r").index(simulator.states[k - first])
        for n in ("x", "y"):
            assert ends[0] is not None and ends[1] is not None
            moved = (ends[0][n][0] - ends[1][n][0]) / h
            assert ran[n][1][:, column] == pytest.approx(moved, abs=2e-3 * max(float(np.abs(moved).max()), 1.0))
