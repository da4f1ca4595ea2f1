"""Two thrusters: coefficients that both share, from force and moment, and the commands back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import MissingChannel, NotInformative, UsageError
from gcs_autotune.thrusters import ThrusterMap, TwinTest, TwinThrusters, fit_twin, read_twin_test
from gcs_autotune.trial import Channel, Trial

C_N, C_V, B = 0.004, 0.03, 0.6


def pulled(seed: int = 1, *, moving: bool = True, noise: float = 0.3, weak: float = 1.0) -> TwinTest:
    rng = np.random.default_rng(seed)
    n_1, n_2 = rng.uniform(-90.0, 90.0, (2, 40))
    V = rng.uniform(0.0, 1.5, 40) if moving else np.zeros(40)
    T_1 = C_N * n_1 * np.abs(n_1) - C_V * V * np.abs(n_1)
    T_2 = weak * (C_N * n_2 * np.abs(n_2) - C_V * V * np.abs(n_2))
    X = T_1 + T_2 + rng.normal(0.0, noise, 40)
    return TwinTest(n_1, n_2, X, V, 0.5 * B * (T_1 - T_2) + rng.normal(0.0, 0.1 * noise, 40))


def test_the_tied_coefficients_are_within_their_errors() -> None:
    apart = []
    for seed in range(40):
        fit = fit_twin(pulled(seed), B)
        assert list(fit.parameters) == ["C_n", "C_v"]
        apart += [(fit.parameters[n].value - true) / fit.parameters[n].std for n, true in (("C_n", C_N), ("C_v", C_V))]
    assert np.std(apart) == pytest.approx(1.0, abs=0.25)


def test_the_moment_improves_the_fit() -> None:
    whole, alone = (fit_twin(t, B).parameters["C_n"].std for t in (pulled(), replace(pulled(), N=None)))
    assert whole < 0.8 * alone


def test_only_the_quadratic_law_is_fitted_at_rest_and_its_inverse_returns_the_forces() -> None:
    fit = fit_twin(pulled(moving=False, noise=0.0), B)
    assert list(fit.parameters) == ["C_T"]
    assert fit.parameters["C_T"].value == pytest.approx(C_N)
    for X, N in ((20.0, 0.0), (0.0, 5.0), (-10.0, 3.0), (25.0, -4.0)):
        back = fit.thrusters.commands(X, N)
        assert not back.saturated
        n_1, n_2 = back.port, back.starboard
        assert C_N * (n_1 * abs(n_1) + n_2 * abs(n_2)) == pytest.approx(X)
        assert 0.5 * B * C_N * (n_1 * abs(n_1) - n_2 * abs(n_2)) == pytest.approx(N)


def test_a_weak_starboard_thruster_is_a_doubt() -> None:
    assert [d.slug for d in fit_twin(pulled(weak=0.8), B).doubts] == ["unequal-thrusters"]
    assert fit_twin(pulled(), B).doubts == ()


def test_the_command_fits_pulses_and_prints_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "twin.csv"
    pulses = np.array([(1500 + a, 1500 + b) for a in range(-400, 401, 200) for b in range(-400, 401, 200)])
    n = pulses - 1500.0
    T = 2e-4 * n * np.abs(n)
    rows = [f"{a},{b},{t[0] + t[1]},{0.3 * (t[0] - t[1])}" for (a, b), t in zip(pulses, T, strict=True)]
    path.write_text("\n".join(["pwm_1[us],pwm_2[us],X[N],N[N m]", *rows]) + "\n")
    assert main(["thrusters", str(path)]) == 2
    assert "--spacing" in capsys.readouterr().err
    assert main(["thrusters", str(path), "--spacing", "0.6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"]["C_T"]["value"] == pytest.approx(2e-4)
    assert main(["thrusters", str(path), "--spacing", "0.6"]) == 0
    assert "1900" in capsys.readouterr().out


def test_a_thruster_that_never_runs_or_a_missing_column_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(NotInformative, match="never runs"):
        fit_twin(replace(pulled(), starboard=np.zeros(40)), B)
    path = tmp_path / "one.csv"
    path.write_text("n_1[rad/s],X[N]\n1,2\n2,3\n")
    with pytest.raises(MissingChannel, match="n_1, n_2"):
        read_twin_test(path)


def test_the_outputs_of_a_flown_run_become_the_forces_of_each_thruster() -> None:
    one = ThrusterMap(10.0, 0.0, 6.0, 0.0, 0.0, 0.0, -1.0, 1.0)
    t = np.array([0.0, 1.0, 2.0])
    outputs = {
        "X": Channel("X", "1", t, np.array([0.0, 0.5, 0.5])),
        "N": Channel("N", "1", t, np.array([0.5, 0.0, 0.2])),
    }
    found = TwinThrusters(one, one, 0.4).forces_of(Trial("run", outputs)).channels
    assert found["X_port"].values == pytest.approx([2.5, 2.5, 4.9])
    assert found["X_starboard"].values == pytest.approx([-1.5, 2.5, 0.9])
    assert found["N_starboard"].values == pytest.approx([0.3, -0.5, -0.18])
    assert (found["N_port"].unit, set(found["arm_starboard"].values)) == ("N m", {-0.2})
    with pytest.raises(UsageError, match="is over us"):
        pulses = replace(one, unit="us")
        TwinThrusters(pulses, pulses, 0.4).forces_of(Trial("run", outputs))
    with pytest.raises(UsageError, match="does not contain"):
        TwinThrusters(one, one, 0.4).forces_of(Trial("run", {"X": outputs["X"]}))
