"""Check whether this computer can run a tune: programs, clock, disk, caches, ports and traffic. Nothing is sent."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Literal

import gcs_autotune
from gcs_autotune.link import BAUDS, Overheard, overhear, serial_ports
from gcs_autotune.workflow.open_runs import open_runs

__all__ = ["Finding", "examine", "listened_to"]

NEEDED = ("pymavlink", "mavsdk", "pyserial", "numpy", "scipy", "numba", "matplotlib", "control", "rich")
OPTIONAL = ("pandas", "xarray", "MAVProxy", "starlette", "uvicorn")
"""Python distributions whose versions are reported.

Those of the second group are optional and reported only if installed.
"""
LEAST_DISK = 200e6
"""Free disk space [bytes] below which a warning is shown.

A tune writes about 20 MB, and a full day of tunes ten times that.
"""
LEAST_SYNC = 1.0
"""Time [s] to write the journal to disk above which control ticks may be late. Project choice."""
LATEST_TICK = 0.02
"""Delay of a timed wait [s] above which a warning is shown: half a control period of a 25 Hz relay."""
WAITS, WAIT = 60, 0.005
"""Number of timed waits in the test of the clock, and the length of each [s]. Project choice."""
UDP = "udpin:0.0.0.0:14550"
"""Address on which ground stations usually listen: BlueOS, companion computers and MAVProxy send to it."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: fine, noteworthy ("note") or an obstacle to a tune ("wrong"), with the remedy."""

    what: str
    state: Literal["fine", "note", "wrong"]
    told: str
    cure: str = ""


def examine(folder: Path, config: Path | None) -> Iterator[Finding]:
    """Yield the findings on this computer, one at a time, except those on its ports.

    folder : folder in which a tune would create its run directory. config : the settings file in use.
    """
    yield from _journals()
    yield _programs()
    yield from _packages()
    yield Finding("settings", "fine", f"settings file {config}" if config else "no settings file gcs-autotune.toml")
    yield _date()
    yield _ticks()
    yield _disk(folder)
    yield _cache()


def listened_to(
    seconds: float, uris: Iterable[str] | None = None, *, say: Callable[[str], object] = str
) -> Iterator[tuple[str, Overheard]]:
    """Listen on each port for *seconds* [s] and yield what was received. Nothing is sent.

    uris : links to listen on instead of every serial port (at the usual speeds) and UDP 14550.
    say : receives the port before listening on it.
    """
    if uris is not None:
        for uri in uris:
            say(f"listening on {uri} for {seconds:g} s")
            yield uri, overhear(uri, seconds)
        return
    for port in serial_ports():
        heard = Overheard(port.device)
        for baud in BAUDS:
            say(f"listening on {port.device} at {baud} baud for {seconds:g} s")
            heard = overhear(f"{port.device},{baud}", seconds)
            if heard.trouble or heard.messages:
                break
        yield str(port), heard
    say(f"listening on UDP 14550 for {seconds:g} s")
    yield "UDP 14550", overhear(UDP, seconds)


def _journals() -> Iterator[Finding]:
    """Yield the unfinished runs of this computer first, because a vehicle may still have trial gains."""
    for run in open_runs():
        cure = "Wait until this run ends" if run.is_going_on else f"gcs-autotune restore {shlex.quote(str(run.path))}"
        yield Finding("run", "note" if run.is_going_on else "wrong", str(run), cure)


def _programs() -> Finding:
    told = f"gcs-autotune {gcs_autotune.__version__}, Python {platform.python_version()}, {platform.platform()}"
    return Finding("program", "fine", f"{told}, {os.cpu_count()} processors ({sys.executable})")


def _packages() -> Iterator[Finding]:
    found, missing = [], []
    for name in NEEDED:
        try:
            found.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            missing.append(name)
    for name in OPTIONAL:
        try:
            found.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            continue
    yield Finding("packages", "fine", ", ".join(found))
    if missing:
        yield Finding("packages", "wrong", f"not installed: {', '.join(missing)}", f"pip install {' '.join(missing)}")


def _date() -> Finding:
    """Check the date. A computer without a battery-backed clock (a Raspberry Pi) may be years off, and run directories
    would sort wrongly."""
    now, ours = time.time(), Path(gcs_autotune.__file__).stat().st_mtime
    told = f"{datetime.fromtimestamp(now):%Y-%m-%d %H:%M} local time"
    if now < ours:
        return Finding(
            "clock", "wrong", f"{told}, which is before this program was installed", "Set this computer's clock"
        )
    synced = _synchronised()
    return Finding(
        "clock", "fine", told + {None: "", True: ", set over the network", False: ", not set over a network"}[synced]
    )


def _synchronised() -> bool | None:
    """Return whether the system clock is synchronised by the network; None if unknown."""
    if shutil.which("timedatectl") is None:
        return None
    asked = ["timedatectl", "show", "--property=NTPSynchronized", "--value"]
    try:
        said = subprocess.run(asked, capture_output=True, text=True, timeout=2.0, check=False).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return None
    return {"yes": True, "no": False}.get(said)


def _ticks() -> Finding:
    """Measure how late this computer wakes from a wait, which limits the control tick."""
    late = 0.0
    for _ in range(WAITS):
        begun = time.monotonic()
        time.sleep(WAIT)
        late = max(late, time.monotonic() - begun - WAIT)
    told = f"largest timing error of {WAITS} waits: {1000.0 * late:.1f} ms"
    if late > LATEST_TICK:
        return Finding("timing", "note", told, "Close other programs: relay switches are delayed by as much")
    return Finding("timing", "fine", told)


def _disk(folder: Path) -> Finding:
    there = next(p for p in (folder.resolve(), *folder.resolve().parents) if p.exists())
    try:
        free = shutil.disk_usage(there).free
        begun = time.monotonic()
        with tempfile.TemporaryFile(dir=there) as stream:
            stream.write(bytes(65536))
            stream.flush()
            os.fsync(stream.fileno())
        took = time.monotonic() - begun
    except OSError as error:
        return Finding(
            "disk", "wrong", f"{there} cannot be written to: {error}", "Work in another folder, or use --out DIR"
        )
    told = f"{free / 1e9:.1f} GB free at {there}, disk write in {1000.0 * took:.0f} ms"
    if free < LEAST_DISK:
        return Finding(
            "disk", "wrong", told, "Free some disk space: the journal needed to restore the vehicle is stored there"
        )
    if took > LEAST_SYNC:
        return Finding("disk", "note", told, "The disk is slow. Use another one")
    return Finding("disk", "fine", told)


def _cache() -> Finding:
    """Check the cache of compiled functions (NUMBA_CACHE_DIR). Without it each run compiles them again."""
    package = Path(gcs_autotune.__file__).parent
    named = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(named) if named else package
    count = sum(1 for _ in home.rglob("*.nbi")) if home.is_dir() else 0
    told = f"{count} compiled kernels stored in {home}"
    if count == 0:
        return Finding(
            "cache",
            "note",
            told,
            "Do a dry run on a simulated vehicle before going on the water: the first command "
            "compiles for up to a minute",
        )
    return Finding("cache", "fine", told)
