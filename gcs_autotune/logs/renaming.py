"""Rename columns and channels as requested by ``--columns``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gcs_autotune.errors import UsageError
from gcs_autotune.sname import INPUTS, column_unit, parse_header
from gcs_autotune.trial import Channel, Trial, as_share

__all__ = ["parse_columns", "renamed"]


def parse_columns(text: str) -> dict[str, str]:
    """Parse ``"t_sim=t[s],heading_deg=psi[deg]"`` into name in the file -> ``channel[unit]``.

    Raises
    ------
    UsageError
        A piece is not of the form ``name=channel[unit]``, or a name occurs twice.
    """
    found: dict[str, str] = {}
    for piece in (p.strip() for p in text.split(",")):
        name, equals, head = piece.partition("=")
        if not equals or not name.strip() or not head.strip():
            raise UsageError(f"--columns: '{piece}' is not name=channel[unit]. Write e.g. heading_deg=psi[deg]")
        if name.strip() in found:
            raise UsageError(f"--columns contains '{name.strip()}' twice. Remove one")
        found[name.strip()] = head.strip()
    if len({parse_header(h)[0] for h in found.values()}) < len(found):
        raise UsageError("--columns maps two columns to the same channel. Change one")
    return found


def renamed(trial: Trial, mapping: Mapping[str, str]) -> Trial:
    """Return *trial* with channels renamed. Values of a channel without a unit are converted to SI.

    mapping : present name -> ``channel[unit]``.

    Raises
    ------
    UsageError
        A name does not exist, a new name already exists, or the unit differs from the channel's own unit.
    """
    missing = [name for name in mapping if name not in trial]
    if missing:
        raise UsageError(
            f"run '{trial.name}' contains no column {', '.join(missing)}. Its columns are {', '.join(trial.channels)}"
        )
    channels: dict[str, Channel] = {}
    notes = list(trial.meta.get("notes", ()))
    for name, channel in trial.channels.items():
        new, unit = parse_header(mapping.get(name, f"{name}[{channel.unit}]"))
        si, factor = column_unit(new, unit)
        if channel.unit == "pwm" and new in INPUTS and unit in ("", "us", "pwm"):
            channels[new], more = as_share(replace(channel, name=new), trial.name)
            notes += more
            continue
        if channel.unit not in ("1", si):
            raise UsageError(f"column {name} of run '{trial.name}' is in {channel.unit}, not {new}[{unit}]")
        if new in channels:
            raise UsageError(f"run '{trial.name}' would have two channels called {new}. Map only one column to {new}")
        scale = factor if channel.unit == "1" else 1.0
        channels[new] = replace(channel, name=new, unit=si, values=channel.values * scale)
    return replace(trial, channels=channels, meta={**trial.meta, "notes": notes} if notes else trial.meta)
