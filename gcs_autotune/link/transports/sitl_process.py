"""A simulated vehicle in a child process, in lock-step over its standard input and output (decision 1)."""

from __future__ import annotations

import importlib.util
import os
import re
import select
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs_autotune.errors import AutotuneError, CannotOpenLink, LinkLost, UnknownName, UsageError
from gcs_autotune.link.transports.transport import SteppedTransport
from gcs_autotune.registry import lookup

__all__ = ["SitlArguments", "SitlProcess", "open_sitl"]

_HEAD = struct.Struct("<dI")
_PATIENCE = 30.0
"""Time [s] after which a step of the child counts as stuck: of the clock if the child sleeps, of the processor if it
works. On a busy computer a child may wait for the processor much longer. The first import is slow. Project choice.
"""
_GRACE = 2.0
_VEHICLE_FILE = ".toml"
_USAGE = 2
"""The child's exit code for a wrong command line: an unknown vehicle, effect or parameter, or an unusable file."""


@dataclass(frozen=True, slots=True)
class SitlArguments:
    """Arguments of the embedded simulator, in the notation of its command line.

    ``name``: the vehicle.
    ``seed``: seed of its noise; None: the vehicle's own.
    ``effects``: effects added to the simulated vehicle (each ``SLUG[@PLACE].PARAM=VALUE,...``).
    ``parameters``: autopilot parameters set before boot (``NAME=VALUE``).
    ``model``: path of a model file to fly instead of the vehicle's own hull.
    ``names``: the firmware generation whose parameter names are used.
    """

    name: str
    seed: int | None = None
    effects: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    model: str | None = None
    names: str | None = None

    @property
    def arguments(self) -> list[str]:
        """Arguments of the simulator's command line."""
        line = [self.name, "--lockstep"]
        if self.seed is not None:
            line += ["--seed", str(self.seed)]
        line += [f"--effect={text}" for text in self.effects]
        line += [f"--param={text}" for text in self.parameters]
        if self.names is not None:
            line.append(f"--firmware-names={self.names}")
        return line if self.model is None else [*line, f"--model={self.model}"]

    @property
    def uri(self) -> str:
        """The connection string for the simulator, without the seed."""
        query = [*(f"effect={e}" for e in self.effects), *(f"param={p}" for p in self.parameters)]
        if self.model is not None:
            query.append(f"model={self.model}")
        if self.names is not None:
            query.append(f"names={self.names}")
        return f"sitl:{self.name}{'?' if query else ''}{'&'.join(t.replace('&', '%26') for t in query)}"


class SitlProcess(SteppedTransport):
    """A link to a simulator started by *command*, which runs in steps of simulated time.

    It has its own session, so Ctrl-C at the terminal does not reach it.
    """

    repeat_period = 0.1
    """Period [s] after which a command is repeated. It is long, because nothing is lost or late on this link, and every
    repetition needs a step of the simulator.
    """

    def __init__(self, command: Sequence[str], description: str, *, quantum: float = 0.1) -> None:
        super().__init__(description, quantum)
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed in _close
        try:
            self._child = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                bufsize=0,
                start_new_session=True,
            )
        except OSError as error:
            self._log.close()
            raise CannotOpenLink(f"cannot start {command[0]}: {error.strerror}") from error
        try:
            self._step(0.0, b"")
        except LinkLost as error:
            output, code = self._remaining_output(), self._child.poll()
            self.close()
            raise _not_started(description, output, code) from error

    def _step(self, grant: float, outgoing: bytes) -> tuple[float, bytes]:
        self._send(_HEAD.pack(grant, len(outgoing)) + outgoing)
        reached, count = _HEAD.unpack(self._receive(_HEAD.size))
        return float(reached), self._receive(count)

    def _send(self, data: bytes) -> None:
        assert self._child.stdin is not None
        try:
            while data:
                data = data[os.write(self._child.stdin.fileno(), data) :]
        except OSError as error:
            raise self._died() from error

    def _receive(self, count: int) -> bytes:
        assert self._child.stdout is not None
        descriptor = self._child.stdout.fileno()
        data = bytearray()
        while len(data) < count:
            if os.name == "posix":
                self._await(descriptor)
            piece = os.read(descriptor, count - len(data))
            if not piece:
                raise self._died()
            data += piece
        return bytes(data)

    def _await(self, descriptor: int) -> None:
        """Wait for the answer of the child, as long as it works or waits for the processor."""
        began = seen = -1.0
        while not select.select([descriptor], [], [], 0.5 * _PATIENCE)[0]:
            waits, spent = _activity_of(self._child.pid)
            stuck = not waits and spent <= seen
            if began < 0.0:
                began, stuck = spent, False
            if stuck or spent - began > _PATIENCE:
                raise self.lost(f"the simulator has not responded for {_PATIENCE:g} s", "start again")
            seen = spent

    def _died(self) -> LinkLost:
        try:
            self._child.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._child.kill()
        output = self._remaining_output()
        return self.lost(f"the simulator ended{': ' + output if output else ''}", "start again")

    def _remaining_output(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else ""

    def _close(self) -> None:
        try:
            self._end_child()
        finally:
            self._log.close()

    def _end_child(self) -> None:
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.close()
        for signal in (None, self._child.terminate, self._child.kill):
            if signal:
                signal()
            try:
                self._child.wait(_GRACE)
                break
            except subprocess.TimeoutExpired:
                continue
        self._child.stdout.close()


def _activity_of(pid: int) -> tuple[bool, float]:
    """Return whether a process waits for processor or disk, and the processor time [s] that it has used.

    False and 0 where there is no ``/proc/PID/stat``, whose fields are in proc(5).
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return fields[0] in ("R", "D"), (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return False, 0.0


def _not_started(description: str, output: str, code: int | None) -> AutotuneError:
    if code == _USAGE and output:
        match = re.search(r"[Dd]id you mean (.*?)\?", output)
        if match is None:
            return UsageError(output)
        nearest = re.split(r",\s*|\s+or\s+", match[1])
        wrong = re.search(r"'(.*?)'", output)
        name = wrong[1] if wrong else description.partition(":")[2]
        return UnknownName(output, name=name, nearest=[n.strip("'\" ") for n in nearest])
    return CannotOpenLink(
        f"the simulator {description} did not start (exit code {code}): {output or 'no message'}. "
        "Check the installation"
    )


def open_sitl(rehearsal: SitlArguments) -> SitlProcess:
    """Start the embedded simulator and return the link to it.

    Raises
    ------
    UnknownName, UsageError
        There is no such vehicle, effect or parameter, or the model cannot be flown. Except for the vehicle, the message
            comes from the simulator.
    CannotOpenLink
        It could not be started.
    """
    _see_vehicle(rehearsal.name)
    return SitlProcess([sys.executable, "-m", "sitl", *rehearsal.arguments], rehearsal.uri)


def _see_vehicle(name: str) -> None:
    """Verify that the simulator has a data file for the vehicle *name*, without starting or importing it.

    The simulator reports this itself, but starting a process only for an error doubles the time. The path of a file is
    not checked here. Nor is any name if the simulator's files are not accessible.

    Raises
    ------
    UnknownName
        There is no such file.
    """
    if name.endswith(_VEHICLE_FILE):
        return
    spec = importlib.util.find_spec("sitl")
    folders = [] if spec is None else spec.submodule_search_locations or []
    files = [file for folder in folders for file in Path(folder, "vehicles").glob(f"*{_VEHICLE_FILE}")]
    if files:
        lookup({file.stem.replace("_", "-"): file for file in sorted(files)}, name, "simulated vehicle")
