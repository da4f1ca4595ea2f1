"""Real runs diagnosed: a command is the normalised output of the servos in the same record."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.real_diagnosis.__main__ import main
from benchmarks.real_diagnosis.by_hand import ALL, by_hand, lines_by_hand
from benchmarks.real_diagnosis.cases import CASES, DATA
from gcs_autotune.trial import Channel, Trial

SPAN = 400.0
"""A motor's pulse [us] from neutral to full."""


@pytest.mark.skipif(not (DATA / "ardupilot_sitl").is_dir(), reason="the recorded runs are not on this machine")
@pytest.mark.parametrize(("name", "force", "servo"), [("sub-yaw", "N", "s1"), ("sub-depth", "Z", "s5")])
def test_the_commands_of_a_sub_are_normalised_motor_outputs(name: str, force: str, servo: str) -> None:
    loaded = CASES[name].load()
    assert [len(runs) for runs in loaded] == [1, 1]
    for runs in loaded:
        for run in runs:
            share, pulse = run[force], run[servo]
            shown = (np.interp(share.t, pulse.t, pulse.values) - 1500.0) / SPAN
            assert share.unit == "1"
            assert np.median(np.abs(share.values - shown)) == pytest.approx(0.0, abs=1e-9), run.name
            assert np.max(np.abs(share.values)) == pytest.approx(np.max(np.abs(shown)))


@pytest.mark.slow
def test_the_independent_fit_identifies_speed_damping_and_prints_each_run() -> None:
    runs = [turning(seed) for seed in (1, 2, 3)]
    fit = by_hand(runs, seconds=2.0)
    plain, damped = fit.errors["linear"], fit.errors["N_|u|r"]
    assert set(plain) == {*(run.name for run in runs), ALL}
    assert all(damped[name] < 0.3 * plain[name] for name in plain)
    lines = lines_by_hand(fit, {"run1": (3.0, 1.0)})
    assert len(lines) == 3 + len(runs) and lines[2].split()[-2:] == ["3.0", "1.0"]
    assert lines[3].split()[-2:] == ["-", "-"]


@pytest.mark.slow
def test_a_single_run_is_held_out_in_parts() -> None:
    fit = by_hand([turning(1)], seconds=2.0)
    assert set(fit.errors["linear"]) == {*(f"run1, part {k}" for k in (1, 2, 3, 4)), ALL}


def test_a_case_without_its_clone_is_skipped_with_a_reason(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("REAL_DIAGNOSIS_CLONES", raising=False)
    assert main(["--case", "milliampere-yaw", "--no-tables"]) == 0
    assert "skipped: a clone of Andeshog/milliampere_data" in capsys.readouterr().out


def turning(seed: int) -> Trial:
    """A boat whose yaw damping grows with its speed ahead and astern, 40 s at 10 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(400) * 0.1
    command = np.repeat(rng.choice([-1.0, 1.0], 20), 20)
    u = 1.5 * np.sin(2.0 * np.pi * t / 25.0 + seed)
    psi, r = np.zeros(400), np.zeros(400)
    for k in range(399):
        r[k + 1] = r[k] + 0.1 * (0.5 * command[k] - 0.5 * r[k] - 1.5 * abs(u[k]) * r[k])
        psi[k + 1] = psi[k] + 0.1 * r[k]
    psi += 1e-3 * rng.standard_normal(400)
    columns = {"psi": ("rad", psi), "r": ("rad/s", r), "u": ("m/s", u), "N": ("N m", command)}
    return Trial(f"run{seed}", {n: Channel(n, unit, t, values) for n, (unit, values) in columns.items()})
