"""``gcs-autotune.toml``: link and limits that need not be typed; known keys only, held to the same table of limits."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import pytest

from gcs_autotune import link
from gcs_autotune.cli import find_config, main, make_parser, read_config
from gcs_autotune.cli.config_file import CONFIG_VARIABLE, ConfigFile, craft_of
from gcs_autotune.errors import BadFile, UnknownName, UsageError
from gcs_autotune.link import Overheard
from gcs_autotune.link.discovery import VehicleCandidate

WHOLE = '[link]\nconnect = "udpin:0.0.0.0:14551"\nsystem-id = 7\nsigning-key = "key.txt"\n[limits]\nmax-distance = 40\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "gcs-autotune.toml"
    path.write_text(text)
    return path


def helped(config: ConfigFile, *verbs: str) -> str:
    reported = io.StringIO()
    with pytest.MonkeyPatch.context() as wide, pytest.raises(SystemExit), contextlib.redirect_stdout(reported):
        wide.setenv("COLUMNS", "400")
        make_parser(config).parse_args([*verbs, "--help"])
    return " ".join(reported.getvalue().split())


def test_values_of_the_file_are_defaults_and_typed_options_override_them(tmp_path):
    config = read_config(written(tmp_path, WHOLE))
    args = make_parser(config).parse_args(["tune", "heading"])
    assert (args.max_distance, args.system_id, args.signing_key) == (40.0, 7, tmp_path / "key.txt")
    assert config.used_by(args) == config.values
    typed = make_parser(config).parse_args(["tune", "heading", "--max-distance", "90", "--connect", "sitl:charlie"])
    assert typed.max_distance == 90.0
    assert set(config.used_by(typed)) == {"system-id", "signing-key"}


def test_the_link_of_a_recorded_run_overrides_the_file(tmp_path):
    config = read_config(written(tmp_path, WHOLE))
    for verb in (["restore"], ["params", "restore", "old.param"]):
        args = make_parser(config).parse_args(verb)
        assert args.connect is None
        assert "connect" not in config.used_by(args)


def test_help_and_run_show_which_file_is_used(tmp_path, monkeypatch, capsys):
    path = written(tmp_path, '[link]\nconnect = "sitl:nosuchboat"\n[limits]\nmax-distance = 40\n')
    config = read_config(path)
    assert "[gcs-autotune.toml: 40]" in helped(config, "tune")
    assert f"settings: {path}" in helped(config, "tune")
    assert "gcs-autotune.toml" not in helped(config, "figures")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(CONFIG_VARIABLE, raising=False)
    assert main(["tune", "heading", "--out", "run"]) == 2
    output = capsys.readouterr().err
    assert f"settings of {path}: connect sitl:nosuchboat, max-distance 40" in output
    assert "nosuchboat" in output.splitlines()[-1]
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[limit]\nmax-distance = 4\n", "Did you mean limits"),
        ("[limits]\nmax-distanse = 40\n", "Did you mean max-distance"),
        ("[link]\nconect = 'sitl:charlie'\n", "Did you mean connect"),
        ("[craft.otter]\nmax-sped = 2\n", r"setting of \[craft.otter\] in .*gcs-autotune.toml 'max-sped'"),
    ],
)
def test_an_unknown_key_is_rejected_with_the_nearest_spelling(tmp_path, text, words):
    with pytest.raises(UnknownName, match=words):
        read_config(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[limits]\nmax-distance = 0.001\n", "max-distance: 0.001 is out of range"),
        ("[limits]\nmax-distance = true\n", "must be a number, not True"),
        ("[limits]\nmax-distance = '40'\n", "must be a number, not '40'"),
        ("[link]\nsystem-id = 1.5\n", "not a whole number"),
        ("[link]\nconnect = 14550\n", "must be text in quotation marks"),
        ("limits = 3\n", "must be a table"),
        ("[craft.otter]\nmax-speed = 'fast'\n", r"gcs-autotune.toml: \[craft.otter\] max-speed: must be a number"),
        ("[craft]\nmax-speed = 2\n", r"Write \[craft.NAME\] and max-speed below it"),
    ],
)
def test_a_value_has_the_same_limits_as_a_typed_one(tmp_path, text, words):
    with pytest.raises(UsageError, match=words):
        read_config(written(tmp_path, text))


CRAFTS = """[limits]
max-distance = 40
[craft.otter]
system-id = 3
max-speed = 2
[craft.pike]
connect = "udpin:127.0.0.1:14561"
max-distance = 90
"""


def chosen(config: ConfigFile, *words: str) -> str:
    return craft_of(config, make_parser(config).parse_args(["tune", "heading", *words]))


def test_a_craft_is_selected_by_name_link_or_received_system_id(tmp_path, monkeypatch):
    config = read_config(written(tmp_path, CRAFTS))
    heard = VehicleCandidate(3, 1, 3, 11, False, 0)
    listened = []
    monkeypatch.setattr(link, "overhear", lambda uri, seconds: listened.append(uri) or Overheard(uri, (heard,)))
    assert chosen(config, "--craft", "pike") == "pike"
    assert chosen(config, "--connect", "udpin:127.0.0.1:14561") == "pike"
    assert chosen(config, "--connect", "sitl:charlie") == chosen(config) == ""
    assert chosen(config, "--connect", "udpin:127.0.0.1:9", "--system-id", "3") == "otter"
    assert chosen(config, "--connect", "udpin:127.0.0.1:9", "--system-id", "4") == ""
    assert listened == []
    assert chosen(config, "--connect", "udpin:127.0.0.1:9") == "otter"
    assert listened == ["udpin:127.0.0.1:9"]
    twice = read_config(written(tmp_path, CRAFTS + "system-id = 3\n"))
    with pytest.raises(UsageError, match=r"several crafts .* match .*: otter, pike. Select one with --craft"):
        chosen(twice, "--connect", "udpin:127.0.0.1:9")


def test_settings_of_a_craft_override_common_ones_and_typed_options_override_both(tmp_path, monkeypatch, capsys):
    config = read_config(written(tmp_path, CRAFTS))
    for craft, distance, speed in (("otter", 40.0, 2.0), ("pike", 90.0, None)):
        args = make_parser(config.of(craft)).parse_args(["tune", "heading"])
        assert args.max_distance == distance and (speed is None or args.max_speed == speed)
    typed = make_parser(config.of("pike")).parse_args(["tune", "heading", "--max-distance", "50"])
    assert (typed.max_distance, typed.configured_link) == (50.0, "udpin:127.0.0.1:14561")
    with pytest.raises(UnknownName, match=r"unknown craft in .*gcs-autotune.toml 'pyke'. Did you mean pike"):
        config.of("pyke")
    with pytest.raises(UsageError, match=r"--craft pike needs a table \[craft.pike\]"):
        ConfigFile().of("pike")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(CONFIG_VARIABLE, raising=False)
    words = ["tune", "heading", "--craft", "otter", "--connect", "sitl:nosuchboat", "--out", "run"]
    assert main(words) == 2
    assert "craft otter: max-distance 40, system-id 3, max-speed 2" in capsys.readouterr().err


def test_a_damaged_file_is_rejected_with_a_workaround(tmp_path):
    with pytest.raises(BadFile, match="set GCS_AUTOTUNE_CONFIG=none to run without"):
        read_config(written(tmp_path, "[limits\n"))


def test_the_environment_overrides_the_folder_and_the_folder_the_user_file(tmp_path, monkeypatch):
    home, here = tmp_path / "home", tmp_path / "here"
    for folder in (home / "gcs-autotune", here):
        folder.mkdir(parents=True)
        written(folder, "[limits]\nmax-distance = 50\n")
    monkeypatch.setattr("platformdirs.user_config_path", lambda name: home / name)
    monkeypatch.delenv(CONFIG_VARIABLE, raising=False)
    monkeypatch.chdir(here)
    assert find_config() == here / "gcs-autotune.toml"
    (here / "gcs-autotune.toml").unlink()
    assert find_config() == home / "gcs-autotune" / "gcs-autotune.toml"
    monkeypatch.setenv(CONFIG_VARIABLE, "none")
    assert find_config() is None
    monkeypatch.setenv(CONFIG_VARIABLE, str(tmp_path / "gone.toml"))
    with pytest.raises(UsageError, match="is not a file"):
        find_config()


@pytest.mark.parametrize("number", ["nan", "inf", "1e999", "9" * 5000, "0x" + "f" * 5000])
def test_a_value_that_is_not_finite_is_rejected_with_its_place(tmp_path, number):
    with pytest.raises(BadFile, match=r"not a finite number|too large|cannot be read as settings"):
        read_config(written(tmp_path, f"[limits]\nmax-distance = {number}\n"))
