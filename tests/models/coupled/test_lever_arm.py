"""A sensor off the centre: what it shows, its sensitivities, and a fit with its known position."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import fit
from gcs_autotune.models import LEVER_ARM, SHOWN_OFF_CENTRE, Form, Simulator
from gcs_autotune.trial import Channel, Trial
from sitl.effects import make_effect
from sitl.open_loop import Hull, open_loop

ARM = {"x_P": 0.8, "y_P": -0.5}
DOFS = ("surge", "sway", "yaw")
DRIVES = {"X": (("X", 1.0),), "Y": (("Y", 1.0),), "N": (("N", 1.0),)}
VALUES = {"X_udot": -5.0, "Y_vdot": -7.0, "N_rdot": -2.0, "X_u": -2.0, "Y_v": -9.0, "N_r": -1.0}
FORM = Form("plain", "", DOFS, tuple(VALUES), {}, DRIVES, coriolis=False)
HULL = Hull(DOFS, {"surge": 5.0, "sway": 7.0, "yaw": 2.0}, {"surge": 2.0, "sway": 9.0, "yaw": 1.0})
UNITS = {"X": "N", "Y": "N", "N": "N m", "psi": "rad", "r": "rad/s", "u": "m/s", "v": "m/s", "x": "m", "y": "m"}


def towed(*measured: str, noise: float = 0.01) -> Trial:
    rng = np.random.default_rng(4)
    commands = {n: size * np.repeat(rng.uniform(-1.0, 1.0, 16), 25) for n, size in zip("XYN", (3, 4, 1), strict=True)}
    place = "+".join(n for n in measured if n in "uvxy")
    columns = open_loop(
        HULL, commands, duration=40.0, interval=0.1, measured=measured, noise=dict.fromkeys(measured, noise),
        effects=[make_effect("sensor-position", place, ARM)],
    )  # fmt: skip
    t = columns.pop("t")
    return Trial("towed", {n: Channel(n, UNITS[n], t, v) for n, v in columns.items()})


@pytest.mark.parametrize("dofs", [DOFS, ("surge", "sway", "heave", "roll", "pitch", "yaw")])
@pytest.mark.parametrize("compass", [(), ("B_psi",)])
def test_sensitivities_of_a_sensor_off_the_centre_are_exact(dofs, compass) -> None:
    letters = dict(zip(("surge", "sway", "heave", "roll", "pitch", "yaw"), "XYZKMN", strict=True))
    speeds = dict(zip(letters, "uvwpqr", strict=True))
    plain = {f"{letters[d]}_{speeds[d]}{end}": -2.0 for d in dofs for end in ("dot", "")}
    values = {**plain, **ARM, **dict.fromkeys(compass, 0.2), "V_x": 0.3}
    form = Form("f", "", dofs, tuple(values), {}, {letters[d]: ((letters[d], 1.0),) for d in dofs}, coriolis=False)
    simulator = Simulator(form, tuple(values), ("psi", "r", "u"))
    t = np.linspace(0.0, 2.0, 5)
    inputs = np.column_stack([np.cos(t + k) for k in range(len(dofs))])
    x_0 = np.array([0.3 + 0.05 * k for k in range(len(simulator.states))])

    def shown(p: np.ndarray) -> dict[str, np.ndarray]:
        start = x_0.copy()
        start[[simulator.states.index(n) for n in ("psi", "r", "u")]] = p[-3:]
        found = simulator.run(p[:-3], start, t, inputs, t)
        assert found is not None
        return {n: simulator.outputs(p[:-3], *found, n)[0] for n in SHOWN_OFF_CENTRE if n in simulator.states}

    p = np.array([*values.values(), *(x_0[simulator.states.index(n)] for n in ("psi", "r", "u"))])
    found = simulator.run(p[:-3], x_0, t, inputs, t)
    assert found is not None
    for name in shown(p):
        _, by = simulator.outputs(p[:-3], *found, name)
        for k in range(len(p)):
            up, down = p.copy(), p.copy()
            up[k] += 1e-5
            down[k] -= 1e-5
            assert by[:, k] == pytest.approx((shown(up)[name] - shown(down)[name]) / 2e-5, abs=2e-6, rel=1e-4), name


@pytest.mark.parametrize("measured", [("u", "v", "r", "psi"), ("x", "y", "psi")])
def test_a_fit_needs_the_sensor_position_to_identify_the_hull(measured) -> None:
    run = towed(*measured)
    result = fit(run, FORM.fixing(ARM), delay=0.0)
    for name, truth in VALUES.items():
        assert abs(result.parameters[name].value - truth) < 4.0 * result.parameters[name].std, name
    sway = measured[1]
    assert result.noise[sway] == pytest.approx(0.01, rel=0.15)
    assert fit(run, FORM, delay=0.0).noise[sway] > 3.0 * result.noise[sway]


def test_an_unknown_sensor_position_is_fitted() -> None:
    found = fit(towed("u", "v", "r", "psi"), FORM.freeing(*LEVER_ARM), delay=0.0)
    for name, truth in ARM.items():
        assert abs(found.parameters[name].value - truth) < 4.0 * found.parameters[name].std < 0.1, name


def test_a_method_without_a_lever_arm_is_rejected_with_those_that_have_it() -> None:
    with pytest.raises(UsageError, match=r"cannot use x_P and y_P.*output-error, global"):
        fit(towed("u", "v", "r", "psi"), FORM.fixing(ARM), "ekf", delay=0.0)
