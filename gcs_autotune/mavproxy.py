"""A MAVProxy module: ``module load gcs_autotune.mavproxy``, then ``autotune heading``, ``autotune stop``.

MAVProxy imports a module by its dotted name if it has no built-in module of that name. It then calls :func:`init`. The
tune runs in a separate thread over MAVProxy's link: it reads what MAVProxy receives, and sends between MAVProxy's
messages. Everything else, from announcement to clean-up, is as in ``gcs-autotune tune``.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs_autotune.cli import carry_out, find_config, make_parser, read_config, tune_settings
from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.link import Transport
from gcs_autotune.observer import stopping
from gcs_autotune.untrusted_text import visible
from gcs_autotune.workflow import Connection, is_settled, restore_run, settled_words

try:
    from MAVProxy.modules.lib.mp_module import MPModule
except ImportError:  # whoever imports this without MAVProxy reads it only
    MPModule = object

__all__ = ["AutotuneModule", "MavproxyLink", "init"]

NAME = "gcs_autotune.mavproxy"
"""Name by which MAVProxy finds the module to unload it."""
USAGE = """usage: autotune AXIS [option ...]   tune a loop, or all (options: autotune AXIS --help)
       autotune yes | no            answer the last question
       autotune stop                stop now: actuators neutral, mode and parameters restored
       autotune restore [RUN]       restore the vehicle after an interrupted run
       autotune status              show the current state"""
_LEAVING = 60.0
"""Time [s] that the clean-up may take when MAVProxy ends. Project choice."""
_SLICE = 0.01


class MavproxyLink(Transport):
    """A link whose bytes MAVProxy receives and sends.

    Parameters
    ----------
    send : sends bytes to the vehicle.
    """

    def __init__(self, description: str, send: Callable[[bytes], object]) -> None:
        super().__init__(description)
        self._send = send
        self._received: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    @property
    def carrier(self) -> str:
        """Name of the program that transports the bytes: MAVProxy."""
        return "MAVProxy"

    def take(self, data: bytes) -> None:
        """Store bytes that MAVProxy has received. MAVProxy's thread calls this."""
        self._received.put(data)

    def _read_available(self, timeout: float) -> bytes:
        found = bytearray()
        with suppress(queue.Empty):
            found += self._received.get(timeout=timeout) if timeout > 0.0 else self._received.get_nowait()
            while True:
                found += self._received.get_nowait()
        return bytes(found)

    def _write(self, data: bytes) -> None:
        try:
            self._send(data)
        except OSError as error:
            raise self.lost(str(error), "check `link` in MAVProxy") from error

    def _close(self) -> None:
        """Do nothing, because MAVProxy keeps its link."""


class _Console:
    """The operator at MAVProxy's prompt."""

    def __init__(self, *, yes: bool) -> None:
        self._yes = yes
        self.stop = False
        self.question = ""
        self.answer: bool | None = None

    @property
    def answered_beforehand(self) -> bool:
        """Whether ``--yes`` answers the questions."""
        return self._yes

    def stop_requested(self) -> bool:
        """Return whether ``autotune stop`` was typed."""
        return self.stop

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Return the answer to a question at the prompt. `autotune yes` and `autotune no` answer the question."""
        if self._yes:
            return True
        self.answer, self.question = None, question
        _print(f"{question} Answer with: autotune yes, or autotune no")
        try:
            while self.answer is None:
                while_waiting()
            return self.answer
        finally:
            self.question = ""


class AutotuneModule(MPModule):  # type: ignore[misc]  # MAVProxy has no types
    """The commands ``autotune ...`` at MAVProxy's prompt."""

    def __init__(self, mpstate: Any) -> None:
        super().__init__(mpstate, NAME, "tune boats and ROVs from a short experiment", multi_vehicle=True)
        self._link: MavproxyLink | None = None
        self._thread: threading.Thread | None = None
        self._person = _Console(yes=True)
        verbs = ["<heading|yaw|speed|depth>", "yes", "no", "stop", "restore", "status"]
        self.add_command("autotune", self.command, "identify and tune a loop (autotune heading, autotune stop)", verbs)

    @property
    def is_busy(self) -> bool:
        """Whether a run is in progress."""
        return self._thread is not None and self._thread.is_alive()

    def command(self, words: Sequence[str]) -> None:
        """Execute the command typed after ``autotune``. Errors are printed as one line."""
        verb = words[0] if words else ""
        try:
            if verb in ("yes", "no"):
                self._answer(verb == "yes")
            elif verb == "stop":
                self._stop()
            elif verb == "status":
                _print(self._status())
            elif verb == "restore":
                self._restore(words[1:])
            elif verb:
                self._tune(words)
            else:
                _print(USAGE)
        except AutotuneError as error:
            _print(str(error))
        except SystemExit:  # argparse after --help
            pass

    def mavlink_packet(self, packet: Any) -> None:
        """Forward a message that MAVProxy has received."""
        link = self._link
        if link is not None:
            link.take(bytes(packet.get_msgbuf()))

    def unload(self) -> None:
        """Stop and clean up before MAVProxy unloads the module.

        During this time it reads the link itself, because MAVProxy no longer does.
        """
        if self.is_busy:
            self._stop()
            end = time.monotonic() + _LEAVING
            while self.is_busy and time.monotonic() < end:
                self._read_links()
                time.sleep(_SLICE)
        self.remove_command("autotune")
        super().unload()

    def _read_links(self) -> None:
        for master in self.mpstate.mav_master:
            with suppress(OSError):
                if data := master.recv(16 * 1024):
                    master.mav.parse_buffer(data)

    def _tune(self, words: Sequence[str]) -> None:
        config = read_config(find_config())
        args = make_parser(config).parse_args(["tune", *words])
        if args.craft:
            args = make_parser(config.of(args.craft)).parse_args(["tune", *words])
        if args.connect is not None or args.remote:
            raise UsageError("MAVProxy provides link and console. Omit --connect and --remote")
        now = datetime.now()

        def work(connection: Connection) -> None:
            from rich.console import Console

            from gcs_autotune.report import TerminalObserver, print_document

            console = Console(force_terminal=False, width=100)
            settings = tune_settings(args, connection, now)
            with TerminalObserver(console, quiet=args.quiet) as observer:
                when = now.isoformat(timespec="seconds")
                document, *_ = carry_out(args, settings, self._person, observer, when)
            print_document(console, document)

        self._begin(f"tune {args.axis}", _Console(yes=args.yes), work)

    def _restore(self, words: Sequence[str]) -> None:
        run = Path(words[0]) if words else None
        if is_settled(run):
            _print(settled_words(run))
            return

        def work(connection: Connection) -> None:
            from rich.console import Console

            from gcs_autotune.report import TerminalObserver

            with TerminalObserver(Console(force_terminal=False, width=100)) as observer:
                for name, (found, old) in restore_run(connection, run, self._person, observer).items():
                    _print(f"{name}: {found:g} -> {old:g}, verified by reading back")

        self._begin("restore", _Console(yes=False), work)

    def _begin(self, what: str, person: _Console, work: Callable[[Connection], None]) -> None:
        """Run *work* in its own thread, over MAVProxy's present link."""
        if self.is_busy:
            raise UsageError(f"{self._status()}. Use autotune stop to end it")
        master = self.master
        signing = getattr(master.mav, "signing", None)
        if signing is not None and signing.sign_outgoing:
            raise UsageError(
                "MAVProxy signs this link, and this module's messages would be unsigned. Add an --out to MAVProxy and "
                "run `gcs-autotune tune` there with --signing-key"
            )
        sticks = self.module("rc")
        if sticks is not None and any(sticks.override):
            raise UsageError("MAVProxy overrides the sticks. Enter `rc all 0` first")
        uri = _as_typed(master)
        self._link, self._person = MavproxyLink(uri, master.write), person

        def run(link: MavproxyLink) -> None:
            rates = self.settings.streamrate, self.settings.streamrate2
            self.settings.streamrate = self.settings.streamrate2 = -1  # else MAVProxy asks for its own ever again
            try:
                work(Connection(uri, opened=link))
                _print(f"{what}: done")
            except AutotuneError as error:
                _print(f"{what}: {error}")
            finally:
                self.settings.streamrate, self.settings.streamrate2 = rates
                self._link = None

        self._thread = threading.Thread(target=run, args=(self._link,), name=what)
        self._thread.start()

    def _answer(self, yes: bool) -> None:
        if not self._person.question:
            raise UsageError("no question is waiting for an answer")
        self._person.answer = yes

    def _stop(self) -> None:
        if not self.is_busy:
            raise UsageError("nothing is running")
        _print(stopping(again=self._person.stop))
        self._person.stop = True

    def _status(self) -> str:
        if self._thread is None or not self.is_busy:
            return "nothing is running"
        asked = f"; open question: {self._person.question}" if self._person.question else ""
        return f"{self._thread.name} is running{asked}"


def _as_typed(master: Any) -> str:
    """Return MAVProxy's link in the form of ``--connect``, so that `gcs-autotune restore` can read it from the
    journal."""
    baud = getattr(master, "baud", None)
    return f"{master.address},{baud}" if baud else str(master.address)


def _print(text: str) -> None:
    """Print at MAVProxy's prompt."""
    print(f"autotune: {visible(text, keep=chr(10))}", flush=True)  # noqa: T201 - MAVProxy's own way


def init(mpstate: Any) -> AutotuneModule:
    """Return the module instance that MAVProxy expects."""
    return AutotuneModule(mpstate)
