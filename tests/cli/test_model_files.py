"""Model files on the command line: identify --effects --save, identify --start, tune --model."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main


def record(path: Path, seed: int) -> Path:
    """Write 40 s at 10 Hz of alpha = 2, beta = 1.5 under random steps with a dead zone of 0.2, exactly solved."""
    rng = np.random.default_rng(seed)
    n, dt, alpha, beta = 400, 0.1, 2.0, 1.5
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 20), 20)
    force = np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)
    decay = np.exp(-beta / alpha * dt)
    r, psi, rows = 0.0, 0.0, ["t[s],N[1],psi[rad],r[rad/s]"]
    for i in range(n):
        noise = rng.normal(0.0, (0.01, 0.02))
        rows.append(f"{i * dt:.1f},{u[i]:.6f},{psi + noise[0]:.6f},{r + noise[1]:.6f}")
        end = force[i] / beta
        psi += end * dt + (r - end) * (1.0 - decay) * alpha / beta
        r = end + (r - end) * decay
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def run(*arguments: object) -> int:
    return main([str(a) for a in arguments])


def test_identify_fits_an_effect_saves_the_model_and_goes_on_from_it(capsys, tmp_path):
    first, second, model = record(tmp_path / "a.csv", 1), record(tmp_path / "b.csv", 2), tmp_path / "model.json"
    assert run("identify", first, "--effects", "dead-zone", "--save", model, "--no-check", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    width = document["parameters"]["dead-zone@N.width"]
    assert abs(width["value"] - 0.2) < 4.0 * width["std"]
    file = json.loads(model.read_text())
    assert file["model"] == "extended" and file["constants"]["units"] == {"N": "1"}
    assert file["known_from"]["parameters"]["dead-zone@N.width"]["unit"] == width["unit"] == "1"
    assert run("identify", second, "--start", model, "--no-check", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again["structure"] == document["structure"]
    assert abs(again["parameters"]["dead-zone@N.width"]["value"] - 0.2) < 4.0 * width["std"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["tune", "heading", "--model", "bessel"], "--function bessel"),
        (["tune", "heading", "--full-scale", "2"], "--model FILE"),
        (["tune", "heading", "--model", "nowhere.json"], "nowhere.json does not exist"),
        (["identify", "a.csv", "--effects", "dead-zone", "--method", "all"], "output-error"),
        (["identify", "a.csv", "--effects", "ded-zone"], "dead-zone"),
    ],
)
def test_an_impossible_request_is_rejected_in_one_line(capsys, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "a.csv", 1)
    assert run(*arguments) != 0
    error = capsys.readouterr().err
    assert words in error and len(error.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "command",
    [
        ("export", "RUN", "--to", "csv"),
        ("fly", "zig-zag", "--preview", "--model", "RUN"),
        ("diagnose", "LOG", "--model", "RUN", "--effects", "dead-zone", "--out", "found"),
        ("identify", "LOG", "--start", "RUN", "--no-check"),
        ("identify", "LOG", "--compare", "RUN", "--no-check"),
    ],
)
def test_a_run_directory_can_be_used_as_its_model(command, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log, folder = record(tmp_path / "a.csv", 1), tmp_path / "flown"
    folder.mkdir()
    words = [str(folder) if w == "RUN" else str(log) if w == "LOG" else w for w in command]
    assert run(*words) == 6
    assert "flown contains no model.json. Identify it first" in capsys.readouterr().err
    assert run("identify", log, "--save", folder / "model.json", "--no-check", "--no-page") == 0
    assert run(*words) == 0
