"""Open-water tests made from K_T and K_Q written out here."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import NotInformative
from gcs_autotune.thrusters import OpenWaterTest, fit_bilinear, fit_open_water

D, RHO = 0.1, 1000.0
KT, KQ = (0.45, -0.30), (0.060, -0.032)


def tank(quadratic: float = 0.0, seed: int = 0, noise: float = 0.05) -> OpenWaterTest:
    rng = np.random.default_rng(seed)
    revs, speed = (g.ravel() for g in np.meshgrid([5.0, 10.0, 15.0, 20.0, 25.0], np.linspace(0.0, 1.2, 7)))
    J = speed / (revs * D)
    T = RHO * D**4 * (KT[0] + KT[1] * J + quadratic * J**2) * revs**2
    Q = RHO * D**5 * (KQ[0] + KQ[1] * J) * revs**2
    return OpenWaterTest(
        2.0 * np.pi * revs, speed, T + rng.normal(0.0, noise, len(T)), Q + rng.normal(0.0, 0.1 * noise, len(Q))
    )


def test_thrust_and_torque_coefficients_are_identified_within_their_errors():
    fit = fit_open_water(tank(), D, rho=RHO)
    assert "value ± standard error  relative" in str(fit) and "standard deviation of one run: T" in str(fit)
    for name, value in {"alpha_1": KT[0], "alpha_2": KT[1], "beta_1": KQ[0], "beta_2": KQ[1]}.items():
        p = fit.parameters[name]
        assert abs(p.value - value) < 3.5 * p.std and p.std < 0.05 * abs(value)
    assert fit.model is not None and len(fit.model.alpha) == 2, "no quadratic term without need"
    J = 0.6
    assert float(fit.model.efficiency(J)) == pytest.approx(
        J * (KT[0] + KT[1] * J) / (2.0 * np.pi * (KQ[0] + KQ[1] * J)), rel=0.02
    )
    assert float(fit.model.thrust(2.0 * np.pi * 20.0, 1.0)) == pytest.approx(
        RHO * D**4 * (0.45 - 0.15) * 400.0, rel=0.02
    )


def test_a_curved_thrust_coefficient_gets_its_quadratic_term():
    fit = fit_open_water(tank(quadratic=-0.15), D, rho=RHO)
    assert fit.model is not None and len(fit.model.alpha) == 3 and len(fit.model.beta) == 2
    assert fit.parameters["alpha_3"].value == pytest.approx(-0.15, abs=0.05)


def test_fitting_forces_scatters_less_than_regressing_ratios():
    ours, ratios = [], []
    for seed in range(40):
        test = tank(seed=seed)
        ours.append(fit_open_water(test, D, rho=RHO, degree=1).parameters["alpha_2"].value)
        revs = test.n / (2.0 * np.pi)
        ratios.append(np.polyfit(test.V_A / (revs * D), test.T / (RHO * D**4 * revs**2), 1)[0])
    assert np.std(ours) < 0.8 * np.std(ratios)
    assert np.mean(ours) == pytest.approx(KT[1], abs=4.0 * np.std(ours) / np.sqrt(40))


def test_bilinear_thrust_is_chosen_in_moving_water_and_quadratic_otherwise():
    rng = np.random.default_rng(2)
    n, v = rng.uniform(-100.0, 100.0, 60), rng.uniform(0.0, 1.0, 60)
    T = 2e-3 * n * np.abs(n) - 0.05 * v * np.abs(n) + rng.normal(0.0, 0.05, 60)
    fit = fit_bilinear(OpenWaterTest(n, v, T))
    assert fit.kind == "bilinear"
    assert fit.parameters["C_n"].value == pytest.approx(2e-3, abs=4 * fit.parameters["C_n"].std)
    assert fit.parameters["C_v"].value == pytest.approx(0.05, abs=4 * fit.parameters["C_v"].std)
    still = fit_bilinear(OpenWaterTest(n, 0.0 * v, 2e-3 * n * np.abs(n) + rng.normal(0.0, 0.05, 60)))
    assert still.kind == "quadratic" and set(still.parameters) == {"C_T"}


def test_bollard_pulls_alone_give_no_thrust_curve():
    with pytest.raises(NotInformative, match="advance number"):
        fit_open_water(OpenWaterTest(np.arange(1.0, 9.0), np.zeros(8), np.arange(1.0, 9.0) ** 2), D)


@pytest.mark.slow
def test_the_command_line_maps_a_pull_test_and_a_propeller(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    n = np.linspace(-100.0, 100.0, 41)
    path = tmp_path / "pull.csv"
    noise = np.random.default_rng(0).normal(0.0, 0.05, 41)
    path.write_text(
        "n[rad/s],T[N]\n" + "\n".join(f"{a},{2e-3 * a * abs(a) + e:.4f}" for a, e in zip(n, noise, strict=True)) + "\n"
    )
    assert main(["thrusters", str(path)]) == 0
    assert "Command for a required force" in capsys.readouterr().out
    assert main(["thrusters", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["model"]["a_f"] == pytest.approx(2e-3, rel=0.02)
    test = tank()
    water = tmp_path / "water.csv"
    assert test.Q is not None
    rows = zip(test.n, test.V_A, test.T, test.Q, strict=True)
    water.write_text("n[rad/s],V_A[m/s],T[N],Q[N m]\n" + "\n".join(",".join(map(str, r)) for r in rows) + "\n")
    assert main(["thrusters", str(water), "--diameter", "0.1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["alpha_1"]["value"] == pytest.approx(0.45, rel=0.02)
    assert main(["thrusters", str(water)]) == 0
    assert "C_n" in capsys.readouterr().out
