from __future__ import annotations

import argparse
import getpass
import io
import sys
from pathlib import Path

import pytest

from gcs_autotune.cli.command import add_connection, connection_of
from gcs_autotune.cli.secret import PASSPHRASE_VARIABLE
from gcs_autotune.errors import UsageError
from gcs_autotune.mavlink import SigningKey

WANTED = SigningKey.from_passphrase("hunter2").secret


def connection(*arguments: str, uri: str = "udpin:0.0.0.0:0") -> SigningKey | None:
    parser = argparse.ArgumentParser()
    add_connection(parser)
    return connection_of(parser.parse_args(arguments), uri).signing


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_key_comes_from_a_file_the_terminal_or_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(PASSPHRASE_VARIABLE, raising=False)
    assert connection() is None
    (tmp_path / "key").write_text("hunter2\n")
    from_file = connection("--signing-key", str(tmp_path / "key"))
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(getpass, "getpass", lambda prompt: "hunter2")
    typed = connection("--signing-passphrase")
    monkeypatch.setenv(PASSPHRASE_VARIABLE, "hunter2")
    from_environment = connection()
    assert connection(uri="sitl:charlie") is None  # the embedded simulator has no key
    for key in (from_file, typed, from_environment):
        assert key is not None and key.secret == WANTED
        assert "hunter2" not in key.origin


def test_two_key_sources_and_a_missing_terminal_are_rejected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="Use one of them"):
        connection("--signing-key", str(tmp_path / "key"), "--signing-passphrase")
    monkeypatch.setattr(sys, "stdin", io.StringIO("hunter2\n"))
    with pytest.raises(UsageError, match=PASSPHRASE_VARIABLE):
        connection("--signing-passphrase")
