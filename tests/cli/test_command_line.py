"""Exit codes, messages and files of commands, all through ``main``, as typed."""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_autotune.cli import COMMANDS, fly_cmd, main, make_parser
from gcs_autotune.cli.writing import folded
from gcs_autotune.errors import EXIT_CODES
from gcs_autotune.link import Journal

from ..conftest import in_few_evaluations


def run(capsys, *arguments):
    code = main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def write(path, rows, head="t[s],psi[rad],r[rad/s],N[N m]"):
    path.write_text(head + "\n" + "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows) + "\n")
    return path


def relay_rows(n=800, dt=0.1):
    """A relay experiment on 0.04 r' + 0.02 r = N + 0.002, exact between samples."""
    psi = r = 0.0
    high, rows = True, []
    for k in range(n):
        high = psi < -0.2 or (high and psi < 0.2)
        tau = 0.06 if high else -0.06
        rows.append((k * dt, psi, r, tau))
        steady, decay = (tau + 0.002) / 0.02, math.exp(-dt / 2.0)
        psi += steady * dt + (r - steady) * 2.0 * (1.0 - decay)
        r = steady + (r - steady) * decay
    return rows


@pytest.mark.slow
def test_tune_heading_works_without_options(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))  # from elsewhere, also when not installed
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "tune", "heading")
    assert code == 0, err
    (directory,) = (tmp_path / "runs").iterdir()
    assert (directory / "report.html").exists()
    assert "better in a measured step" in out
    assert "gcs-autotune params restore" in out
    rows = [line.split()[0] for line in err.splitlines() if line and not line.startswith(" ")]
    table = rows[rows.index("Arms") :]
    assert table[:7] == ["Arms", "Moves", "Space", "Time", "Battery", "Writes", "Go"]
    assert "will arm the vehicle" not in err


@pytest.fixture(scope="module")
def dry_run(tmp_path_factory) -> Path:
    """The directory that a dry run of a simulated ROV leaves."""
    out = tmp_path_factory.mktemp("dry") / "run"
    with in_few_evaluations():
        assert main(["tune", "heading", "--connect", "sitl:automarine", "--dry-run", "--out", str(out)]) == 0
    return out


@pytest.mark.slow
def test_identify_gives_the_same_model_from_the_run_directory_as_the_tune_did(capsys, dry_run):
    code, text, _ = run(capsys, "identify", dry_run, "--json")
    assert code == 0
    again, tuned = json.loads(text), json.loads((dry_run / "fit.json").read_text())
    assert again["structure"] == tuned["structure"]
    for name, p in tuned["parameters"].items():
        # The record knows the commands of the lead-in as well, the tune at the time only those since the relay began.
        assert again["parameters"][name]["value"] == pytest.approx(p["value"], abs=max(0.6 * p["std"], 1e-9))


def test_identify_reads_a_users_csv_and_prints_the_promised_json(capsys, tmp_path):
    code, out, _ = run(capsys, "identify", write(tmp_path / "mine.csv", relay_rows()), "--json")
    assert code == 0
    fit = json.loads(out)
    assert fit["dof"] == "yaw"
    assert fit["structure"] == "linear"
    assert set(fit["parameters"]) >= {"alpha_r", "beta_r", "beta_rr", "delta"}
    assert set(fit["parameters"]["alpha_r"]) >= {"value", "unit", "std"}
    assert fit["parameters"]["alpha_r"]["value"] == pytest.approx(0.04, rel=1e-3)
    assert fit["parameters"]["beta_r"]["value"] == pytest.approx(0.02, rel=1e-3)
    assert fit["parameters"]["delta"]["value"] == pytest.approx(0.002, rel=1e-2)
    assert isinstance(fit["doubts"], list)


@pytest.mark.slow
def test_degrees_and_milliseconds_are_converted(capsys, tmp_path):
    rows = [(t * 1e3, math.degrees(psi), math.degrees(r), N) for t, psi, r, N in relay_rows()]
    path = write(tmp_path / "deg.csv", rows, "t[ms],psi[deg],r[deg/s],N[N m]")
    code, out, _ = run(capsys, "identify", path, "--json")
    assert code == 0
    assert json.loads(out)["parameters"]["alpha_r"]["value"] == pytest.approx(0.04, rel=1e-3)


@pytest.mark.slow
def test_a_truncated_csv_loses_only_its_last_row_and_raises_a_doubt(capsys, tmp_path):
    path = write(tmp_path / "cut.csv", relay_rows())
    path.write_bytes(path.read_bytes()[:-20])
    code, out, _ = run(capsys, "identify", path, "--json")
    assert code == 0
    assert any("row" in d["slug"] or "row" in d["cause"] for d in json.loads(out)["doubts"])


BAD_FILES = {
    "damaged in the middle": ("t[s],psi[rad],N[N m]\n0,0,1\n0.1,x,1\n0.2,0,1\n", "row 3"),
    "no head": ("1,2,3\n4,5,6\n", "no header line"),
    "unknown unit": ("t[s],psi[furlong],N[N m]\n0,0,1\n0.1,0,1\n", "furlong"),
    "empty": ("", "is empty"),
    "too short": ("t[s],psi[rad],N[N m]\n0,0,1\n0.1,0,-1\n0.2,0,1\n", "too short"),
    "nothing moves": (
        "t[s],psi[rad],N[N m]\n" + "".join(f"{i / 10},0,{1 if i % 40 < 20 else -1}\n" for i in range(300)),
        "",
    ),
    "constant input": (
        "t[s],psi[rad],N[N m]\n" + "".join(f"{i / 10},{i / 50},1\n" for i in range(300)),
        "never changes",
    ),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_an_unusable_file_gives_one_clear_line_and_exit_code_6(capsys, tmp_path, case):
    text, words = BAD_FILES[case]
    (tmp_path / "bad.csv").write_text(text)
    code, out, err = run(capsys, "identify", tmp_path / "bad.csv")
    assert code == 6
    assert out == ""
    assert err.startswith("gcs-autotune: ")
    assert words in err
    assert "Traceback" not in err


def test_a_file_that_is_not_a_log_is_rejected_in_one_line(capsys, tmp_path):
    (tmp_path / "x.tlog").write_bytes(b"\x00" * 30)
    code, _, err = run(capsys, "identify", tmp_path / "x.tlog")
    assert code == 6
    assert "no MAVLink message" in err
    assert err.count("\n") == 1


def test_the_error_for_an_unknown_vehicle_names_the_nearest(capsys, tmp_path):
    code, _, err = run(capsys, "tune", "heading", "--connect", "sitl:charly", "--out", tmp_path / "r")
    assert code == 2
    assert "charlie" in err


def test_a_port_in_use_is_reported(capsys, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        code, _, err = run(capsys, "tune", "heading", "--connect", f"udpin:127.0.0.1:{port}", "--out", tmp_path / "r")
    assert code == 3
    assert "in use" in err and "udpout" in err


def test_a_refused_connection_is_reported(capsys, tmp_path):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    code, _, err = run(capsys, "tune", "heading", "--connect", f"tcp:127.0.0.1:{port}", "--out", tmp_path / "r")
    assert code == 3
    assert "refused" in err


def test_a_missing_serial_port_is_reported(capsys, tmp_path):
    code, _, err = run(capsys, "tune", "heading", "--connect", "/dev/ttyNOSUCH,57600", "--out", tmp_path / "r")
    assert code == 3
    assert "/dev/ttyNOSUCH" in err


def test_a_depth_tune_of_a_boat_is_rejected(capsys, tmp_path):
    code, _, err = run(capsys, "tune", "depth", "--connect", "sitl:charlie", "--out", tmp_path / "r")
    assert code == 4
    assert "no depth loop" in err
    assert not (tmp_path / "r").exists(), "a run that was refused leaves no report of an abort"


@pytest.mark.slow
def test_a_real_vehicle_is_left_alone_if_no_confirmation_is_possible(capsys, tmp_path, monkeypatch):
    """Over UDP, without --yes and without a terminal: an error before anything is armed."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    sim = [sys.executable, "-m", "sitl", "blueboat", "--listen", f"udp:127.0.0.1:{port}", "--speedup", "5"]
    with subprocess.Popen(sim, stderr=subprocess.PIPE, text=True) as vehicle, Path(os.devnull).open() as nothing:
        assert vehicle.stderr is not None
        vehicle.stderr.readline()
        monkeypatch.setattr(sys, "stdin", nothing)
        try:
            link = f"udpout:127.0.0.1:{port}"
            code, _, err = run(capsys, "tune", "heading", "--connect", link, "--out", tmp_path / "r")
        finally:
            vehicle.terminate()
    assert code == 2
    assert "--yes" in err
    assert not list((tmp_path / "r" / "trials").glob("*.csv"))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_ctrl_c_ends_the_process_cleanly_with_code_130(tmp_path):
    tune = [sys.executable, "-m", "gcs_autotune", "tune", "heading", "--out", str(tmp_path / "r")]
    with subprocess.Popen(tune, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.strip() == "first self-oscillation":  # also announced before, in a longer line
                process.send_signal(signal.SIGINT)
                break
        output = process.stderr.read()
        assert process.wait(30) == 130
    assert "mode and armed state restored" in output
    assert output.splitlines()[-1] == f"Report: {tmp_path / 'r' / 'report.html'}"
    assert "--resume" in output
    assert "No parameter was written." in output
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["ending"] == "aborted"
    assert summary["differences"] == {}


@pytest.mark.slow
def test_params_are_saved_and_restored_through_files(capsys, tmp_path):
    path = tmp_path / "all.param"
    assert run(capsys, "params", "save", path, "--connect", "sitl:charlie")[0] == 0
    text = path.read_text()
    assert "ATC_STR_RAT_P,0.2" in text
    wanted = tmp_path / "some.param"
    wanted.write_text("# mine\nATC_STR_RAT_P,0.35\nATC_STR_ANG_P 2\n")
    code, out, err = run(capsys, "params", "restore", wanted, "--yes", "--connect", "sitl:charlie")
    assert code == 0, err
    assert "ATC_STR_RAT_P: 0.2 -> 0.35" in out
    assert "1 parameter changed" in out


def test_an_invalid_parameter_file_writes_nothing(capsys, tmp_path):
    (tmp_path / "bad.param").write_text("ATC_STR_RAT_P=0.3\n")
    code, _, err = run(capsys, "params", "restore", tmp_path / "bad.param", "--yes", "--connect", "sitl:charlie")
    assert code == 6
    assert "line 1" in err


def test_restoring_requires_an_explicit_vehicle(capsys, tmp_path):
    (tmp_path / "some.param").write_text("ATC_STR_RAT_P,0.35\n")
    code, _, err = run(capsys, "params", "restore", tmp_path / "some.param", "--yes")
    assert code == 2
    assert "--connect" in err


@pytest.mark.slow
def test_the_undo_line_of_the_report_finds_the_vehicle_in_the_journal(capsys, dry_run):
    code, text, err = run(capsys, "params", "restore", dry_run, "--yes")
    assert code == 0, err
    assert "link: sitl:automarine" in err
    assert "0 parameters changed" in text


def test_restore_rejects_another_vehicle(capsys, tmp_path):
    journal = [
        {"event": "opened", "vehicle": {"system": 7, "autopilot": 3, "vehicle_type": 11}, "link": "sitl:charlie"},
        {"event": "lent", "name": "ATC_STR_RAT_P", "value": 0.1},
        {"event": "writing", "name": "ATC_STR_RAT_P", "value": 0.4},
    ]
    (tmp_path / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in journal))
    code, _, err = run(capsys, "restore", tmp_path, "--yes")
    assert code == 4
    assert "not the one" in err
    assert Journal.open_debts(tmp_path / "journal.jsonl") == {"ATC_STR_RAT_P": 0.1}


def test_restore_reports_if_there_is_nothing_to_restore(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "restore")
    assert (code, out) == (0, "Nothing to restore: the folder runs/ contains no unfinished run.\n")


def test_help_lists_every_command_and_every_exit_code(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capsys.readouterr().out
    assert all(name in out for name in COMMANDS)
    assert all(f"  {code}  " in out or f"{code:5d}  " in out for _, code, _ in EXIT_CODES)


def test_the_two_kinds_of_restore_refer_to_each_other(capsys):
    for call, other in (["restore"], "params restore"), (["params"], "gcs-autotune restore"):
        with pytest.raises(SystemExit):
            main([*call, "--help"])
        assert other in " ".join(capsys.readouterr().out.split())


def test_without_a_command_the_help_is_shown(capsys):
    assert main([]) == 0
    assert "exit codes:" in capsys.readouterr().out


EVERYDAY = [name for name, verb in COMMANDS.items() if verb.load().everyday]


@pytest.mark.parametrize("verb", EVERYDAY)
def test_help_is_short_and_help_all_has_every_option(verb, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown = []
    for option in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as ended:
            main([verb, option])
        assert ended.value.code == 0
        shown.append(capsys.readouterr().out)
    short, whole = shown
    command = COMMANDS[verb].load()
    assert len(command.everyday) <= 14
    assert len(short.splitlines()) < 0.75 * len(whole.splitlines())
    assert max(map(len, short.splitlines())) <= 80
    assert all(f"--{option}" in short and f"--{option}" in whole for option in command.everyday)
    assert short.endswith(f"lists all {len(options_of(verb))} options.\n")
    for call, _ in command.examples:
        words = call.split()
        assert words[:2] == ["gcs-autotune", verb]
        assert {w for w in words if w.startswith("--")} <= options_of(verb)


def options_of(verb: str) -> set[str]:
    """The long options of a command."""
    parser = make_parser(only=verb)
    verbs = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return {a.option_strings[-1] for a in verbs.choices[verb]._actions if a.option_strings}


@pytest.mark.parametrize(
    ("options", "seconds"),
    [((), 1800.0), (("--max-time", "120"), 120.0), (("--max-time", "120", "--total-time", "9"), 540.0)],
)
def test_max_time_limits_the_whole_self_planned_trial(options, seconds):
    args = make_parser(only="fly").parse_args(["fly", "--until", "alpha_r 5%", *options])
    precision = fly_cmd._precision(args)
    assert precision is not None
    assert precision.seconds == seconds


def test_sitl_lists_its_vehicles():
    done = subprocess.run(
        [sys.executable, "-m", "gcs_autotune", "sitl", "--list"], capture_output=True, text=True, check=True
    )
    for name in ("charlie", "videoray", "automarine", "falcon"):
        assert name in done.stdout


@pytest.mark.slow
def test_an_experiment_identifies_surge_and_writes_no_parameter(capsys, tmp_path):
    out = tmp_path / "run"
    code, text, err = run(capsys, "experiment", "surge", "--out", out, "--json")
    assert code == 0, err
    fit = json.loads(text)
    assert fit["dof"] == "surge"
    assert fit["parameters"]["alpha_u"]["value"] == pytest.approx(8.2372 / 8.0, rel=0.02)
    assert fit["parameters"]["beta_u"]["value"] == pytest.approx(4.4283 / 8.0, rel=0.03)
    assert "Writes   no parameter" in err
    journal = map(json.loads, (out / "journal.jsonl").read_text().splitlines())
    assert {e["event"] for e in journal} == {"opened", "ordering", "ordered", "closed"}, "no parameter is borrowed"


def test_a_heave_experiment_on_a_boat_is_rejected(capsys, tmp_path):
    code, _, err = run(capsys, "experiment", "depth", "--connect", "sitl:charlie", "--out", tmp_path / "run")
    assert code == 4
    assert "has no depth" in err


@pytest.mark.slow
def test_identify_writes_a_page_and_prints_its_path(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "identify", write(tmp_path / "mine.csv", relay_rows()))
    assert code == 0
    assert "Report: identify-mine.html" in out
    assert "<!DOCTYPE html>" in (tmp_path / "identify-mine.html").read_text()


@pytest.mark.slow
def test_identify_compares_all_methods_and_validates_on_a_held_out_run(capsys, tmp_path):
    first, second = write(tmp_path / "a.csv", relay_rows()), write(tmp_path / "b.csv", relay_rows(500))
    code, out, _ = run(
        capsys, "identify", first, "--validate", second, "--structure", "linear", "--method", "all", "--json"
    )
    assert code == 0
    data = json.loads(out)
    assert {r["run"] for r in data["validation"]["runs"]} == {"b"}
    assert {"output-error", "iso"} <= set(data["methods"])


def test_identify_lists_its_methods_and_needs_a_run(capsys):
    code, out, _ = run(capsys, "identify", "--method", "list")
    assert code == 0
    assert "output-error" in out
    code, _, err = run(capsys, "identify")
    assert code == 2
    assert "no run given" in err


def test_identify_names_missing_inputs_of_a_plan_or_choice_of_terms(capsys, tmp_path):
    mine = write(tmp_path / "mine.csv", relay_rows())
    code, _, err = run(capsys, "identify", mine, "--plan", "usv_6def")
    assert code == 2
    assert "usv_6dof" in err
    code, _, err = run(capsys, "identify", mine, "--thrusters", mine)
    assert (code, "--plan" in err) == (2, True)
    code, _, err = run(capsys, "identify", mine, "--plan", "usv_twin", "--thrusters", mine)
    assert (code, "--spacing M" in err) == (2, True)
    code, _, err = run(capsys, "identify", mine, "--plan", "usv_twin")
    assert (code, "Add --thrusters" in err) == (2, True)
    (tmp_path / "map.json").write_text("[]")
    known = ("--plan", "usv_twin", "--spacing", "0.14", "--thrusters", tmp_path / "map.json")
    code, _, err = run(capsys, "identify", mine, *known)
    assert code != 0
    assert "is not a thruster map" in err
    code, _, err = run(capsys, "identify", mine, "--choose")
    assert code == 2
    assert "--dof horizontal" in err
    code, _, err = run(capsys, "identify", mine, "--known", "m=heavy", "--dof", "horizontal")
    assert code == 2
    assert "not a number" in err


def test_identify_fits_a_coupled_model_and_proposes_further_runs(capsys, tmp_path):
    rows, x = [], [0.0, 0.0, 0.0, 0.0]  # psi, u, v, r of a craft with its own integrator, 100 steps a second
    for k in range(4000):
        X, N = (4.0, 8.0, 2.0, 6.0)[k // 1000], (1.0, -1.0, 1.5, 0.0, -0.5)[k // 400 % 5]
        if k % 10 == 0:
            rows.append((k / 100.0, *x, X, N))
        psi, u, v, r = x
        du = (X - 3.0 * u - 4.0 * abs(u) * u + 18.0 * v * r) / 12.0
        dv = (-9.0 * v - 12.0 * u * r) / 18.0
        dr = (N - 1.5 * r + (12.0 - 18.0) * u * v) / 2.0
        x = [psi + 0.01 * r, u + 0.01 * du, v + 0.01 * dv, r + 0.01 * dr]
    path = write(tmp_path / "free.csv", rows, head="t[s],psi[rad],u[m/s],v[m/s],r[rad/s],X[N],N[N m]")
    form = tmp_path / "mine.toml"
    form.write_text(
        'name = "mine"\ndofs = ["surge", "sway", "yaw"]\n'
        'free = ["X_udot", "Y_vdot", "N_rdot", "X_u", "X_uu", "Y_v", "N_r"]\n'
        "[inputs.X]\nX = 1\n[inputs.N]\nN = 1\n"
    )
    code, out, err = run(capsys, "identify", path, "--structure", form, "--no-check", "--plan-next", "30", "--json")
    assert code == 0, err
    data = json.loads(out)
    assert data["parameters"]["X_udot"]["value"] == pytest.approx(-12.0, rel=0.02)
    assert data["parameters"]["N_r"]["value"] == pytest.approx(-1.5, rel=0.02)
    assert data["plan_next"]["rows"]


def test_identify_states_profile_likelihood_intervals_and_rejects_unfitted_parameters(capsys, tmp_path):
    path, page = write(tmp_path / "mine.csv", relay_rows(400)), tmp_path / "page.html"
    options = ("--structure", "linear", "--delay", "0", "--no-check", "--json", "--page", page)
    code, out, err = run(capsys, "identify", path, "--profile", "alpha_r", *options)
    assert code == 0, err
    (sentence,) = json.loads(out)["intervals"]
    assert sentence.startswith(("alpha_r is between 0.04", "alpha_r is between 0.039"))
    assert "Deviance (-2 log-likelihood) over each parameter" in page.read_text()
    assert run(capsys, "identify", path, "--profile", "alpha_q", *options)[0] == 2


@pytest.mark.parametrize("text", ["X", "X=-1", "Q=3", "X=8;N=2"])
def test_an_invalid_full_scale_is_explained(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t[s],psi[rad],N\n0,0,0\n1,0,0\n")
    assert main(["identify", str(path), "--full-scale", text]) == 2
    assert "Give the force [N] or moment [N m] at full output" in capsys.readouterr().err


@pytest.mark.slow
def test_recheck_heading_reports_the_present_loop_and_writes_no_parameter(tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["recheck", "heading", "--connect", "sitl:blueboat", "--out", str(out)]) == 0
    output = capsys.readouterr()
    assert "heading loop" in output.out
    assert "Writes no parameter" in " ".join(output.err.split())
    assert (out / "report.html").exists()


def test_the_list_of_manoeuvres_wraps_between_options_and_lists_existing_ones(capsys):
    code, out, _ = run(capsys, "fly", "--list")
    assert code == 0
    assert not re.search(r"-$", out, re.MULTILINE)
    assert "Takes ." not in out
    assert "Takes --heading, --rudder," in re.sub(r"\s+", " ", out)


@pytest.mark.parametrize(
    ("line", "verbs"),
    [
        ("compare run --qqqq", "compare"),
        ("tune heading --qqqq", "tune"),
        ("params save file --qqqq", "params save"),
        ("study watch a --qqqq", "study watch"),
    ],
)
def test_an_unknown_option_points_to_the_help_of_its_command(
    line: str, verbs: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    printed = capsys.readouterr().err
    assert printed == f"gcs-autotune: unrecognized arguments: --qqqq (see `gcs-autotune {verbs} --help`)\n"


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_an_error_is_wrapped_on_a_terminal_and_one_line_in_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    text = "gcs-autotune: " + "a word after another " * 5 + "/a/path/that/is/longer/than/a/line/of/the/terminal.param"
    lines = folded(text, _Terminal()).splitlines()
    assert " ".join(lines) == text and max(map(len, lines[:-1])) <= 40
    assert folded(text, io.StringIO()) == f"{text}\n"
