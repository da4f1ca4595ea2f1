"""Read the signing key from the command line, the terminal or the environment. It is never shown."""

from __future__ import annotations

import argparse
import getpass
import os
import sys
from typing import TYPE_CHECKING

from gcs_autotune.errors import UsageError

if TYPE_CHECKING:
    from gcs_autotune.mavlink import SigningKey

__all__ = ["PASSPHRASE_VARIABLE", "signing_of"]

PASSPHRASE_VARIABLE = "GCS_AUTOTUNE_SIGNING_PASSPHRASE"


def signing_of(args: argparse.Namespace, uri: str) -> SigningKey | None:
    """Return the signing key for the vehicle at *uri*, from the options or the environment; None if there is none.

    The embedded simulator has no key; the environment variable applies to other vehicles.

    Raises
    ------
    UsageError, BadFile
        Both options are used, standard input is not a terminal, or the file contains no key.
    """
    from gcs_autotune.mavlink import SigningKey

    if args.signing_key is not None and args.signing_passphrase:
        raise UsageError("--signing-key and --signing-passphrase both select the key. Use one of them")
    if args.signing_key is not None:
        return SigningKey.read(args.signing_key)
    if args.signing_passphrase:
        if not sys.stdin or not sys.stdin.isatty():
            raise UsageError(
                "cannot ask for the signing passphrase: standard input is not a terminal. "
                f"Use --signing-key FILE or set {PASSPHRASE_VARIABLE}"
            )
        return SigningKey.from_passphrase(getpass.getpass("Signing passphrase: "), "passphrase typed")
    passphrase = os.environ.get(PASSPHRASE_VARIABLE)
    if passphrase and not uri.startswith("sitl:"):
        return SigningKey.from_passphrase(passphrase, f"passphrase in {PASSPHRASE_VARIABLE}")
    return None
