"""``gcs-autotune design``: gains, margins and relays from a model at the desk."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.api import example_run, save_trial
from gcs_autotune.cli import main
from gcs_autotune.cli.hold_cmd import LAWS
from gcs_autotune.mavlink import load_params
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Mark, Trial

YAW = SingleDof("yaw", "1", 2.0, 1.5, 0.5, 0.01, 0.3)
HEAVE = SingleDof("heave", "N", 200.0, 150.0, 50.0, 0.0, 0.1)


def written(path: Path, model: SingleDof) -> Path:
    path.write_text(json.dumps(model.to_dict()), encoding="utf-8")
    return path


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    assert main(["design", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["design", *map(str, arguments), "--no-page"]) != 0
    return capsys.readouterr().err


@pytest.mark.slow
def test_gains_for_ardurover_are_printed_with_the_defaults_saved_and_shown_on_a_page(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model = written(tmp_path / "boat.json", YAW)
    assert main(["design", str(model), "--for", "heading", "--speed", "1.5", "--save", "new.param"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for words in ("Old values: the firmware's defaults", "disk margin, phase", "new, worst case", "pole [rad/s]"):
        assert words in out
    assert "10 % in inertia and 20 % in drag is assumed" in out
    gains = load_params(tmp_path / "new.param")
    assert set(gains) == {*(f"ATC_STR_RAT_{n}" for n in ("FF", "P", "I", "D")), "ATC_STR_ANG_P"}
    assert gains["ATC_STR_RAT_FF"] > 0.5
    page = (tmp_path / "design-heading.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 3


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
@pytest.mark.parametrize("known_from", ["parameters", "run"])
def test_gains_are_designed_for_the_autopilot_of_the_parameters_or_of_the_run(known_from, capsys, tmp_path):
    source, more = written(tmp_path / "model.json", YAW), ()
    if known_from == "parameters":
        stored = tmp_path / "vehicle.param"
        stored.write_text("ATC_RAT_YAW_P,0.2\nATC_ANG_YAW_P,5.5\n", encoding="utf-8")
        more = ("--parameters", stored)
    else:
        run = example_run()
        (tmp_path / "trials").mkdir()
        save_trial(replace(run, meta={**run.meta, "firmware": "ArduSub"}), tmp_path / "trials" / "03-relay-1.csv")
        source = tmp_path
    found = printed(capsys, source, "--for", "heading", *more)
    assert found["firmware"] == "ardusub"
    assert {*found["gains"]} >= {"ATC_RAT_YAW_P", "ATC_ANG_YAW_P"}


def test_the_loop_is_the_one_that_the_run_tuned_unless_it_is_stated(capsys, tmp_path):
    written(tmp_path / "model.json", YAW)
    assert "add what to design: --for heading, yaw" in refused(capsys, tmp_path)
    start = tmp_path / "setting_out.json"
    start.write_text('{"settings": {"axis": "heading"}}', encoding="utf-8")
    assert "no speed given" in refused(capsys, tmp_path)  # ArduRover's heading
    assert "not surge" in refused(capsys, tmp_path, "--for", "speed")
    for damaged in ("[1]", '{"settings": 3}'):
        start.write_text(damaged, encoding="utf-8")
        assert "setting_out.json" in refused(capsys, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_a_folder_with_only_a_model_can_be_designed_for(capsys, tmp_path):
    written(tmp_path / "model.json", YAW)
    assert printed(capsys, tmp_path, "--for", "heading", "--speed", "1.5")["firmware"] == "ardurover"
    assert "no speed given. Use --speed" in refused(capsys, tmp_path, "--for", "heading")


@pytest.mark.slow
def test_all_styles_are_designed_into_one_file_to_compare_them(tmp_path, briefly, capsys):
    model, file = written(tmp_path / "rov.json", HEAVE), tmp_path / "styles.json"
    assert main(["design", str(model), "--for", "depth", "--full-scale", "100", "--styles", str(file)]) == 0
    found = json.loads(file.read_text())["styles"]
    assert [one["at"] for one in found] == sorted(one["at"] for one in found)
    assert [one["style"] for one in (found[0], found[4], found[8])] == ["gentle", "normal", "quick"]
    styles = {one["style"]: one for one in found}
    for style, least in (("gentle", 3.5), ("normal", 2.5), ("quick", 2.0)):
        found, step = styles[style], styles[style]["step"]
        assert found["margins"]["gain"] is None or found["margins"]["gain"] > 0.99 * least
        assert len({len(step[name]) for name in ("t", "before", "after", "low", "high", "output")}) == 1
        assert len(step["t"]) <= 2 * 300 and step["after"][-1] == pytest.approx(step["size"], abs=0.05)
        assert 0.0 < found["largest_output"] <= 1.0
    assert styles["gentle"]["metrics"]["after"]["itae"] > styles["quick"]["metrics"]["after"]["itae"]
    assert "cannot be written" in refused(capsys, model, "--for", "depth", "--full-scale", "100", "--styles", tmp_path)


def test_styles_are_not_compared_if_another_option_sets_the_speed(tmp_path, capsys):
    model = written(tmp_path / "rov.json", HEAVE)
    for other in (("--omega-0", "1"), ("--own",), ("--style", "quick")):
        assert "without --own" in refused(capsys, model, "--for", "depth", "--styles", tmp_path / "s.json", *other)


def test_present_gains_are_read_from_a_parameter_file(capsys, tmp_path):
    model, held = written(tmp_path / "boat.json", YAW), tmp_path / "present.param"
    held.write_text("ATC_STR_RAT_FF,1.25\nATC_STR_ANG_P,1.5\n", encoding="utf-8")
    found = printed(capsys, model, "--for", "heading", "--speed", "1.5", "--settling-time", "8", "--parameters", held)
    changes = {change["parameter"]: change for change in found["proposal"]["changes"]}
    assert changes["ATC_STR_RAT_FF"]["old"] == 1.25
    assert found["present"] == "present.param, defaults for ATC_STR_RAT_P, ATC_STR_RAT_I, ATC_STR_RAT_D"
    assert found["before"]["disk_margin"]["size"] > 0.0


@pytest.mark.parametrize(
    ("loop", "model", "options"),
    [
        ("depth", HEAVE, ("--full-scale", "100", "--omega-0", "0.8")),
        ("yaw", YAW, ("--speed", "1.5", "--omega-0", "1.5")),
        ("speed", SingleDof("surge", "1", 2.0, 0.3, 0.15, 0.0, 0.1), ("--throttle", "0.6", "--omega-0", "0.8")),
    ],
)
def test_every_loop_of_the_autopilot_keeps_its_margins_over_the_region(capsys, tmp_path, loop, model, options):
    found = printed(capsys, written(tmp_path / "craft.json", model), "--for", loop, *options)
    worst = found["after"]["worst_margins"]
    assert worst["stable"] and worst["phase"] > math.radians(44.0) and worst["gain"] > 2.4
    assert all(real < 0.0 for real, _ in found["after"]["poles"])


def test_a_speed_loop_gets_the_measured_pair_of_throttle_and_speed(capsys, tmp_path):
    model = SingleDof("surge", "1", 2.0, 0.3, 0.15)
    found = printed(capsys, written(tmp_path / "craft.json", model), "--for", "speed", "--throttle", "0.6")
    kept = model.steady_velocity(0.6)
    assert (found["gains"]["CRUISE_THROTTLE"], found["gains"]["CRUISE_SPEED"]) == (60.0, pytest.approx(kept, rel=0.01))


def test_our_own_loop_is_slower_to_keep_the_required_margin(capsys, tmp_path):
    model = written(tmp_path / "boat.json", YAW)
    fast = printed(capsys, model, "--for", "heading", "--own")
    wide = printed(capsys, model, "--for", "heading", "--own", "--gain-margin", "3.5")
    assert wide["loop"]["margins"]["gain"] > 3.5 > fast["loop"]["margins"]["gain"]
    assert wide["wanted"]["omega_0"] < fast["wanted"]["omega_0"]
    line = printed(capsys, model, "--for", "line", "--speed", "1.5", "--guidance", "indirect")
    assert line["wanted"] == fast["wanted"]
    assert {"K_psi", "K_r", "K_d", "K_I"} < set(line["line"])


def test_the_relay_of_example_6_3_is_predicted(capsys, tmp_path):
    example = SingleDof("yaw", "1", math.degrees(0.3 / 50.0), math.degrees(1.0 / 50.0))  # 50/(s(0.3s+1)) in degrees
    model = written(tmp_path / "example.json", example)
    found = printed(
        capsys, model, "--for", "relay", "--relay-output", "1", "--relay-hysteresis", "20.28", "--control-rate", "100"
    )
    assert math.degrees(found["X_m"]) == pytest.approx(24.47, rel=0.02)
    assert found["period"] == pytest.approx(2.8, rel=0.03)
    late = printed(
        capsys, model, "--for", "relay", "--relay-output", "1", "--relay-hysteresis", "16", "--control-rate", "5"
    )
    assert math.degrees(late["X_m"]) == pytest.approx(24.47, rel=0.10)
    assert late["period"] == pytest.approx(2.8, rel=0.10)


def test_a_run_directory_supplies_model_speed_and_present_gains(capsys, tmp_path):
    run = example_run()
    (tmp_path / "trials").mkdir()
    about = {"manoeuvre": "relay", "purpose": "identification", "dof": "yaw", "speed": 1.2}
    save_trial(replace(run, meta=about), tmp_path / "trials" / "01-relay.csv")
    (tmp_path / "parameters_before.param").write_text("ATC_STR_ANG_P,3\n", encoding="utf-8")
    found = printed(capsys, tmp_path, "--for", "heading", "--omega-0", "1")
    assert found["present"].startswith("parameters_before.param, defaults for ATC_STR_RAT_FF")
    old = {change["parameter"]: change["old"] for change in found["proposal"]["changes"]}
    assert (old["ATC_STR_ANG_P"], old["ATC_STR_RAT_P"]) == (3.0, 0.2)
    assert found["model"] == tmp_path.name


def flown_run(folder: Path, windows: tuple[float, float]) -> Path:
    """Write a run directory whose tune flew a heading step of 20 deg and compared it over *windows* [s]."""
    (folder / "trials").mkdir()
    written(folder / "model.json", YAW)
    (folder / "gains.json").write_text(json.dumps({"axis": "heading", "windows": windows}), encoding="utf-8")
    t, size = np.arange(0.0, 40.0, 0.1), math.radians(20.0)
    psi = size * ((t > 5.0) & (t < 25.0)) + np.random.default_rng(1).normal(0.0, 0.002, len(t))
    about = {"purpose": "proof", "signal": "psi", "size": size, "duration": 20.0, "speed": 1.5, "enough": 5.0}
    marks = tuple(Mark(at, "target", {"value": value}) for at, value in ((0.0, 0.0), (5.0, size), (25.0, 0.0)))
    step = Trial("step-before", {"psi": Channel("psi", "rad", t, psi)}, marks, meta={**about, "lasted": [20.0, 15.0]})
    save_trial(step, folder / "trials" / "02-step-before.csv")
    return folder


def test_a_run_is_judged_over_the_times_over_which_its_tune_compared_the_steps(capsys, tmp_path):
    run = flown_run(tmp_path, (7.0, 6.0))
    found = printed(capsys, run, "--for", "heading", "--omega-0", "1")
    assert found["proposal"]["windows"] == [7.0, 6.0]
    assert found["proposal"]["predicted"]["after"]["span"] == pytest.approx(6.0)
    for more, words in (((), "7 s after the step and 6 s after the step back"), (("--step", "40"), "another size")):
        assert main(["design", str(run), "--for", "heading", "--omega-0", "1", "--no-page", *more]) == 0
        assert words in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--for", "heading"), "Use --speed"),
        (("--for", "depth"), "not heave"),
        (("--for", "speed", "--own"), "Use heading, depth or line"),
        (("--for", "line"), "Use --speed"),
        (("--for", "heading", "--own", "--omega-0", "9"), "The fastest that is possible is"),
        (("--for", "heading", "--own", "--save", "x.param"), "--save writes gains of the autopilot"),
        (("--for", "heading", "--relay-output", "0.3"), "--relay-output applies only to --for relay"),
        (("--for", "heading", "--omega-0", "1", "--settling-time", "3"), "not both"),
        (("--for", "relay", "--relay-output", "0.02", "--dof", "heave"), "not heave"),
        (("--for", "relay", "--relay-hysteresis", "90"), "out of range"),
    ],
)
def test_an_impossible_design_is_rejected_with_advice(capsys, tmp_path, arguments, words):
    assert words in refused(capsys, written(tmp_path / "boat.json", YAW), *arguments)


def test_a_relay_weaker_than_the_constant_force_is_rejected(capsys, tmp_path):
    model = written(tmp_path / "boat.json", replace(YAW, delta=0.2))
    assert "Use a larger output" in refused(capsys, model, "--for", "relay", "--relay-output", "0.1")


def test_the_default_line_design_matches_hold(capsys, tmp_path):
    found = printed(capsys, written(tmp_path / "boat.json", YAW), "--for", "line", "--speed", "1.5")
    assert found["guidance"] == LAWS[0]


@pytest.mark.slow
@pytest.mark.parametrize(("loop", "more"), [("heading", ("--speed", "1.2")), ("heading", ("--own",))])
def test_a_gentle_loop_has_wider_margins_and_about_half_the_bandwidth(capsys, tmp_path, loop, more):
    model = written(tmp_path / "boat.json", YAW)
    normal, gentle = (printed(capsys, model, "--for", loop, "--style", s, *more) for s in ("normal", "gentle"))
    loops = [found.get("after", found.get("loop")) for found in (normal, gentle)]
    worst = [loop["worst_margins"] for loop in loops]
    assert worst[1]["gain"] > max(3.4, worst[0]["gain"])
    if "--own" in more:
        assert gentle["wanted"]["omega_0"] <= 0.51 * normal["wanted"]["omega_0"]
    else:
        assert gentle["gains"] != normal["gains"]


def test_style_and_a_frequency_contradict_each_other(capsys, tmp_path):
    model = written(tmp_path / "boat.json", YAW)
    output = refused(capsys, model, "--for", "heading", "--style", "gentle", "--omega-0", "1")
    assert "--style gentle and --omega-0 both set the speed of the loop" in output
