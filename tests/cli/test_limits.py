"""Every number of every command: finite and in range, else rejected by name before link, directory or compiler."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

import sitl.__main__
from gcs_autotune.cli import main, make_parser
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import LIMITS, Limit, axes_of, finite, limit_of
from gcs_autotune.link import open_link
from gcs_autotune.manoeuvres import Envelope, RelaySettings
from gcs_autotune.workflow import Connection, TuneSettings

POSITIONALS = {
    "authority": ("a.json",),
    "design": ("a.json", "--for", "heading"),
    "tune": ("heading",),
    "experiment": ("heading",),
    "aboard": ("heading",),
    "fly": ("zig-zag",),
    "recheck": ("heading",),
    "hold": ("heading",),
    "identify": ("a.csv",),
    "diagnose": ("a.csv",),
    "figures": ("a.csv",),
    "study run": ("a.toml",),
    "study watch": ("a",),
    "study report": ("a",),
    "study replay": ("a", "b"),
    "thrusters": ("a.csv",),
    "navigate": ("a.bin",),
    "laser": ("a.mp4",),
    "track": ("a.mp4", "a.csv"),
    "calibrate laser": ("a.csv",),
    "logs list": ("a.tlog",),
    "logs import": ("a.tlog",),
    "logs fetch": ("--connect", "sitl:charlie"),
    "params save": ("all.param", "--connect", "sitl:charlie"),
    "params restore": ("all.param", "--connect", "sitl:charlie"),
    "restore": (),
    "watch": ("a.csv", "b.csv"),
    "compare": ("a.csv", "b.csv"),
    "share": ("a",),
    "doctor": (),
    "ports": (),
}
"""Command -> what it cannot do without."""
RENAMED = {("figures", "speed"): "trial-speed"}
"""(Command, option) -> its row in the table, where the option is called otherwise."""


def commands(parser: argparse.ArgumentParser, path: tuple[str, ...] = ()) -> Iterator[tuple[str, argparse.Action]]:
    """Walk all options of all commands below *parser*."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from commands(below, (*path, name))
        else:
            yield " ".join(path), action


OPTIONS = [(command, a) for command, a in commands(make_parser()) if a.type is not None]
NUMBERS = [(command, a.option_strings[0][2:]) for command, a in OPTIONS if getattr(a.type, "__name__", "") == "number"]


def rows(command: str, option: str) -> list[tuple[str, Limit]]:
    """Return (positional axis, limit) for all that hold for an option of a command."""
    found = axes_of(RENAMED.get((command, option), option))
    axes = {"tune": ("heading", "depth", "speed", "yaw"), "experiment": ("heading", "depth", "surge")}
    axes = {**axes, "aboard": ("heading", "depth")}.get(command, ())
    return [(row.axis, row) for row in found if not row.axis or row.axis in axes]


def outside(row: Limit) -> list[str]:
    beyond = [row.greatest * 1.01 + 1.0, 1e30]
    below = [row.least - 1.0 - 0.01 * abs(row.least), -1e30] if not row.signed else [-1.01 * row.greatest - 1.0]
    between = [0.5 * row.least] if row.least > 0.0 else []
    whole = [row.least + 0.25] if row.whole else []
    return ["nan", "inf", "-inf", "zwei", "", *(f"{v:.9g}" for v in (*beyond, *below, *between, *whole))]


CASES = [
    (command, option, axis, value)
    for command, option in NUMBERS
    for axis, row in rows(command, option)
    for value in outside(row)
]


@pytest.fixture
def bare(tmp_path, monkeypatch):
    """An empty directory to be in, and a link that must not be opened."""

    def opened(*args: object, **kwargs: object) -> None:
        raise AssertionError("a link was opened")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gcs_autotune.link.open_link", opened)
    monkeypatch.setattr("gcs_autotune.workflow.settings.open_link", opened)
    monkeypatch.setattr("gcs_autotune.workflow.mission.jit_warmup", opened)
    return tmp_path


def refusal(arguments, capsys) -> str:
    """Run a command line that must be rejected as wrong usage; return the one-sentence reason."""
    code = main(list(arguments))
    out, err = capsys.readouterr()
    assert code == 2, (arguments, err)
    assert out == ""
    assert "Traceback" not in err
    assert err.startswith("gcs-autotune: ") and err.count("\n") == 1
    return str(err)


def test_every_number_of_every_command_is_checked_by_the_table_of_limits():
    assert len(NUMBERS) > 60
    plain = [(command, a.option_strings) for command, a in OPTIONS if a.type in (int, float)]
    assert plain == []
    assert {limit.name for limit in LIMITS.values()} == {RENAMED.get(pair, pair[1]) for pair in NUMBERS}


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted({command for command, _ in NUMBERS}))
def test_every_number_outside_its_limits_is_rejected_by_name_first(command, bare, capsys, monkeypatch):
    cases, parser = [case for case in CASES if case[0] == command], make_parser()
    assert cases
    monkeypatch.setattr("gcs_autotune.cli.make_parser", lambda *of: parser)  # made once: it is most of the time
    for _, option, axis, value in cases:
        positionals = (axis,) if axis else POSITIONALS[command]
        output = refusal((*command.split(), *positionals, f"--{option}={value}"), capsys)
        assert f"--{option}: " in output, (option, value, output)
        assert list(bare.iterdir()) == []


ABSURD = {
    "--max-distance": ("nan", "-5"),
    "--max-time": ("nan", "inf"),
    "--max-heading-excursion": ("nan",),
    "--min-battery": ("nan", "500"),
    "--throttle": ("50", "nan"),
    "--relay-output": ("5", "30"),
    "--step-duration": ("0", "nan"),
    "--speed": ("nan", "99", "-3"),
    "--control-rate": ("0", "1e9"),
    "--source-system": ("300", "-2"),
    "--relay-hysteresis": ("nan",),
    "--step": ("500", "nan"),
    "--delay": ("-5", "nan"),
    "--settling-time": ("0", "nan"),
    "--omega-0": ("-1", "inf"),
    "--system-id": ("999",),
    "--max-roll": ("nan",),
}


def test_absurd_values_are_rejected_at_once(bare, capsys):
    output = [refusal(("tune", "heading", o, v), capsys) for o, values in ABSURD.items() for v in values]
    assert len(output) == 31
    assert list(bare.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "typed", "words"),
    [
        ("--relay-output", "5", "Did you mean 0.05"),
        ("--throttle", "50", "Did you mean 0.5"),
        ("--step", "500", "Did you mean 5 (500 in hundredths of a degree)"),
        ("--step", "0.5", "Did you mean 28.6479 (0.5 in radians)"),
        ("--speed", "120", "Did you mean 1.2"),
        ("--max-distance", "-5", "Did you mean 5?"),
        ("--relay-output", "0,3", "Did you mean 0.3?"),
        ("--baud", "57", "Did you mean 57000"),
        ("--max-time", "99999", "Did you mean 99.999 (99999 in milliseconds)"),
    ],
)
def test_a_rejection_suggests_the_intended_value(option, typed, words, bare, capsys):
    assert words in refusal(("tune", "heading", option, typed), capsys)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("--known", "m=nan"), "--known m=nan"),
        (("--known", "m=-Infinity"), "--known m=-Infinity"),
        (("--known", "m=1e300"), "--known m=1e300"),
        (("--option", "horizon=inf"), "--option horizon=inf"),
        (("--option", "horizon=1e400"), "--option horizon=1e400"),
        (("--pick", "0"), "--pick 0"),
        (("--pick", "-2"), "--pick -2"),
        (("--pick", "2,nan"), "--pick 2,nan"),
    ],
)
def test_numbers_inside_a_text_are_checked(arguments, name, bare, capsys):
    Path("a.csv").write_text("t[s],psi[rad],N[N m]\n0,0,1\n0.1,0,1\n")
    output = refusal(("identify", "a.csv", f"{arguments[0]}={arguments[1]}"), capsys)
    assert name in output


@pytest.mark.parametrize("argument", ["--speedup=nan", "--speedup=inf", "--speedup=0", "--speedup=1e9", "--seed=-1"])
def test_the_numbers_of_the_simulator_are_checked(argument, capsys):
    assert sitl.__main__.main(["charlie", argument]) == 2
    assert argument.partition("=")[0] in capsys.readouterr().err


def test_the_simulator_rejects_a_parameter_that_is_not_a_number(capsys):
    assert sitl.__main__.main(["charlie", "--param=ATC_STR_RAT_P=nan"]) == 2
    assert "finite" in capsys.readouterr().err


def test_the_help_shows_every_range(capsys):
    for command in ("tune", "identify", "figures"):
        with pytest.raises(SystemExit):
            main([command, "--help-all" if command != "figures" else "--help"])
        shown = " ".join(capsys.readouterr().out.split())
        for called, option in NUMBERS:
            if called == command:
                for _, row in rows(command, option):
                    assert row.range in shown, (command, option)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("step", math.radians(500.0)),
        ("step", math.nan),
        ("step_duration", 0.0),
        ("relay_output", 5.0),
        ("relay_hysteresis", math.nan),
        ("throttle", 50.0),
        ("speed", -3.0),
        ("control_rate", 1e9),
        ("delay", -5.0),
        ("settling_time", 0.0),
        ("omega_0", math.inf),
        ("full_scale", 0.0),
    ],
)
def test_settings_made_in_a_program_obey_the_same_table(field, value, tmp_path):
    with pytest.raises(UsageError, match=field.replace("_", "-")):
        TuneSettings(Connection("sitl:charlie"), tmp_path, axis="heading", **{field: value})


@pytest.mark.parametrize("field", ["baud", "system_id", "source_system", "seed"])
def test_a_connection_made_in_a_program_obeys_the_same_table(field):
    with pytest.raises(UsageError, match=field.replace("_", "-")):
        Connection("sitl:charlie", **{field: -2})


@pytest.mark.parametrize("row", list(LIMITS.values()), ids=lambda r: f"{r.name} {r.axis}".strip())
def test_the_ends_of_every_range_and_every_default_are_inside_it(row):
    for value in (row.least, row.greatest, *(() if row.default is None else (row.default,))):
        assert row.check(value) == value
        row.check_si(value * row.factor)
    assert row.reason and not row.reason.endswith(".")


def test_defaults_of_the_table_are_those_of_the_envelope():
    made = Envelope()
    assert math.radians(limit_of("max-heading-excursion").default) == pytest.approx(made.heading_excursion)
    assert limit_of("max-depth-excursion").default == made.depth_excursion
    assert math.radians(limit_of("max-roll").default) == pytest.approx(made.roll)
    assert math.radians(limit_of("max-pitch").default) == pytest.approx(made.pitch)
    assert limit_of("min-battery").default / 100.0 == pytest.approx(made.battery_remaining)
    assert limit_of("max-time").default == made.time


@pytest.mark.parametrize("limit", ["heading_excursion", "depth_max", "speed", "distance", "battery_remaining", "time"])
@pytest.mark.parametrize("value", [math.nan, -1.0])
def test_an_envelope_with_invalid_limits_cannot_be_created(limit, value):
    with pytest.raises(UsageError, match=limit):
        Envelope(**{limit: value})


@pytest.mark.parametrize(
    "wrong",
    [
        {"output": 5.0},
        {"output": math.nan},
        {"hysteresis": 0.0},
        {"hysteresis": math.nan},
        {"most_output": -0.1, "throttle": 1.0},
        {"throttle": math.nan},
    ],
)
def test_a_relay_that_cannot_oscillate_cannot_be_created(wrong):
    with pytest.raises(UsageError, match="relay"):
        RelaySettings("psi", "N", **wrong)


@pytest.mark.parametrize(
    ("name", "typed", "value"),
    [("max-time", "30min", 1800.0), ("max-time", "90 s", 90.0), ("max-time", "90", 90.0), ("total-time", "0.5h", 30.0)],
)
def test_a_time_may_have_a_unit(name, typed, value):
    assert limit_of(name).parse(typed) == value


@pytest.mark.parametrize("typed", ["tenmin", "10m", "min", "1e9h", "nans"])
def test_a_malformed_time_is_rejected(typed):
    with pytest.raises(UsageError, match=r"not a number|out of range|not a finite"):
        limit_of("max-time").parse(typed)


def test_no_other_number_has_a_unit_of_time():
    with pytest.raises(UsageError, match="is not a number"):
        limit_of("max-distance").parse("30min")


def test_onboard_log_numbers_go_up_to_16_bits():
    assert limit_of("number").parse("65535") == 65535
    with pytest.raises(UsageError, match="65536 is out of range"):
        limit_of("number").parse("65536")


@pytest.mark.parametrize("text", ["1_0", "٣٠", "0x10", "1e", "", "1 0", "++1", "1,0", "²", "9" * 5000, "1e999", "nan"])
def test_numbers_need_ascii_digits_and_a_long_one_is_truncated_in_the_error(text):
    for name in ("max-distance", "max-time", "system-id", "neutral"):
        with pytest.raises(UsageError) as refused:
            limit_of(name).parse(text)
        assert len(str(refused.value)) < 300
    with pytest.raises(UsageError):
        finite(text)


@pytest.mark.parametrize(
    "arguments",
    [
        ("identify", "a.csv", "--pick", "9" * 5000),
        ("identify", "a.csv", "--pick", "٣"),
        ("identify", "a.csv", "--known", "m=" + "9" * 5000),
        ("identify", "a.csv", "--known", "m=1_0"),
        ("identify", "a.csv", "--option", "horizon=" + "[" * 5000),
        ("identify", "a.csv", "--full-scale", "N=1_0"),
        ("thrusters", "a.csv", "--forces", "1_0,2"),
        ("fly", "--until", "N_r 1.2.3%"),
        ("fly", "--until", "N_r " + "9" * 500 + "%"),
        ("serve", "--port", "٣"),
    ],
)
def test_numbers_inside_any_option_are_checked_and_truncated_in_errors(arguments, bare, capsys):
    Path("a.csv").write_text("t[s],psi[rad],N[N m]\n0,0,1\n0.1,0,1\n")
    assert len(refusal(arguments, capsys)) < 500


@pytest.mark.parametrize(
    "uri", ["udpin:127.0.0.1:٣", "udpin:127.0.0.1:²", "tcp:127.0.0.1:" + "9" * 5000, "sitl:charlie?seed=" + "9" * 5000]
)
def test_numbers_of_a_link_are_checked_the_same_way(uri):
    with pytest.raises(UsageError) as refused:
        open_link(uri)
    assert len(str(refused.value)) < 300
