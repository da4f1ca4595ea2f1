"""``identify RUNDIR`` uses the settings and effects of the run itself."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from gcs_autotune.cli import main

WIDTH = 0.05


@pytest.mark.slow
def test_runs_fitted_with_effects_are_fitted_with_them_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows, psi, r = [], 0.0, 0.0
    for k in range(600):  # 0.04 r' + 0.02 r = what exceeds the dead zone of N, exact between samples
        size = 0.06 if k < 300 else 0.15
        N = size if k % 80 < 40 else -size
        rows.append(f"{0.1 * k:.1f},{psi:.9f},{r:.9f},{N}")
        steady, decay = math.copysign(abs(N) - WIDTH, N) / 0.02, math.exp(-0.05)
        psi += 0.1 * steady + (r - steady) * 2.0 * (1.0 - decay)
        r = steady + (r - steady) * decay
    run = tmp_path / "run"
    (run / "trials").mkdir(parents=True)
    (run / "trials" / "01-relay.csv").write_text("t[s],psi[rad],r[rad/s],N[1]\n" + "\n".join(rows) + "\n")
    plain, model = ["identify", str(run), "--no-check", "--json"], run / "model.json"

    def found(*more: str) -> dict[str, float]:
        assert main([*plain, *more]) == 0
        parameters = json.loads(capsys.readouterr().out)["parameters"]
        return {name: reported["value"] for name, reported in parameters.items()}

    assert "dead-zone@N.width" not in found("--save", str(model)), "a model without effects"
    assert "dead-zone@N.width" not in found()
    found("--structure", "linear", "--delay", "0.2", "--save", str(model))
    assert "alpha_r" in found(), "a delay alone is no effect"
    found("--structure", "linear", "--effects", "dead-zone@N", "--save", str(model))
    assert found()["dead-zone@N.width"] == pytest.approx(WIDTH, rel=0.05)
    assert "dead-zone@N.width" not in found("--structure", "linear"), "explicit options override the recorded ones"
