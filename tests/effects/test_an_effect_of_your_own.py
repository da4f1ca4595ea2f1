"""The guide on effects in docs/developing.md, followed step by step: one file outside the package and one line."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.effects import EFFECTS
from gcs_autotune.effects.table import GROUP
from gcs_autotune.errors import UsageError

GUIDE = (Path(__file__).parents[2] / "docs" / "developing.md").read_text(encoding="utf-8")
INERTIA, DRAG, COEFFICIENT = 2.0, 0.5, 1.5


def guide_code(language: str) -> str:
    """Return the code of that *language* in the guide's section on effects."""
    section = GUIDE.split("## An effect of your own")[1].split("\n## ")[0]
    (code,) = re.findall(rf"```{language}\n(.*?)```", section, re.DOTALL)
    return str(code)


@pytest.fixture
def offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Put the guide's module on Python's path, as an installed package leaves it, with *more* lines in addition."""

    def offer(**more: str) -> None:
        (tmp_path / "waves_made.py").write_text(guide_code("python"))
        lines = {**tomllib.loads(guide_code("toml"))["project"]["entry-points"][GROUP], **more}
        described = tmp_path / "waves_made-1.0.dist-info"
        described.mkdir()
        rows = "".join(f"{name} = {where}\n" for name, where in lines.items())
        (described / "entry_points.txt").write_text(f"[{GROUP}]\n{rows}")
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "waves_made", raising=False)
        monkeypatch.setattr(EFFECTS, "_rows", None)  # as in a new process

    return offer


def flown(path: Path, seed: int) -> Path:
    """Write a run of ``2 r' + 0.5 r + 1.5 r^3 = N``, with noise."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1.5, 1.5, 15), 20)
    rows, psi, r = [], 0.0, 0.0
    for k, N in enumerate(command.tolist()):
        noise = rng.normal(0.0, 0.004, 2)
        rows.append((0.1 * k, psi + noise[0], r + noise[1], N))
        for _ in range(50):
            psi, r = psi + 0.002 * r, r + 0.002 * (N - DRAG * r - COEFFICIENT * r**3) / INERTIA
    np.savetxt(path, rows, delimiter=",", header="t[s],psi[rad],r[rad/s],N[N m]", comments="", fmt="%.6f")
    return path


@pytest.mark.slow
def test_a_plug_in_effect_is_diagnosed_fitted_and_listed_on_the_command_line(offered, tmp_path, capsys):
    offered()
    runs = [str(flown(tmp_path / f"run{seed}.csv", seed)) for seed in (1, 2)]
    assert main(["diagnose", *runs, "--effects", "cubic-drag,dead-zone,input-bias", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["causes"]) == ("effect-found", ["cubic-drag"])
    assert found["found"][0]["parameters"]["coefficient"]["value"] == pytest.approx(COEFFICIENT, rel=0.05)
    assert main(["identify", *runs, "--effects", "cubic-drag", "--json"]) == 0
    fitted = json.loads(capsys.readouterr().out)["parameters"]
    (value,) = [p["value"] for name, p in fitted.items() if "cubic-drag" in name]
    assert value == pytest.approx(COEFFICIENT, rel=0.05)
    assert main(["diagnose", "--list-effects"]) == 0
    assert "cubic-drag" in capsys.readouterr().out


def test_a_plug_in_that_cannot_be_loaded_is_reported(offered):
    offered(broken="waves_made:nothing")
    with pytest.raises(UsageError, match=r"'broken' \(waves_made:nothing\) cannot be loaded"):
        len(EFFECTS)


def test_a_plug_in_that_is_not_an_effect_is_rejected(offered):
    offered(odd="builtins:dict")
    with pytest.raises(UsageError, match=r"'odd' \(builtins:dict\) does not produce"):
        len(EFFECTS)


def test_every_effect_states_what_it_acts_on_or_is_a_disturbance():
    assert len(EFFECTS) > 30
    for effect in EFFECTS.values():
        assert effect.acts_on or effect.is_disturbance, effect.slug
        assert not (effect.is_rounding and not effect.is_disturbance), effect.slug
