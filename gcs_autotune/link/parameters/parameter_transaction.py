"""Temporary parameter changes.

Old values are saved to disk first and restored in reverse order unless the new ones are kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from types import TracebackType
from typing import Self

from gcs_autotune.errors import AutotuneError, LinkLost, NoReply, NotAsFound, ParameterNotAccepted, PreconditionFailed
from gcs_autotune.firmware import checked_all
from gcs_autotune.link.parameters.client import Parameters, same_float32
from gcs_autotune.link.parameters.journal import Journal

__all__ = ["ParameterTransaction"]

_PATIENCE = 30.0
"""Time [s] to wait for a silent vehicle before the restore fails. A boat may be behind a pier. Project choice."""
_ROUNDS = 3
"""Number of rounds of restoring and verifying.

A delayed write of ours may arrive after the old value was restored. Project choice.
"""


class _Changed(AutotuneError):
    """Raised if a parameter has changed after its restore, by a delayed write of ours or by another station."""


class ParameterTransaction:
    """Temporary changes of parameters.

    As a context manager it restores everything on exit, unless :meth:`keep` was called.

    Attributes
    ----------
    old : name -> original value of every parameter that may be changed.
    written : names written and not yet kept or restored, in order.
    """

    def __init__(self, parameters: Parameters, journal: Journal) -> None:
        self._session = parameters.session
        self._parameters = parameters
        self._journal = journal
        self.old: dict[str, float] = {}
        self.written: list[str] = []
        self._left: dict[str, float] = {}

    def lend(self, names: Iterable[str]) -> dict[str, float]:
        """Read the original values of *names*, record them in the journal, and return name -> value.

        Raises
        ------
        ParameterMissing, TelemetryFault
            One of them does not exist, or the answers contradict each other. Then none may be changed.
        PreconditionFailed
            The value of one could not be restored later (not a number), or the journal cannot be written.
        """
        wanted = list(dict.fromkeys(names))
        new = checked_all(self._parameters.read_confirmed([name for name in wanted if name not in self.old]))
        for name, value in new.items():
            self._journal.record("lent", name=name, value=value)
            self.old[name] = value
        self._parameters.watch(new)
        return {name: self.old[name] for name in wanted}

    def set(self, values: Mapping[str, float]) -> None:
        """Write all of *values* (name -> value). On any failure restore everything and raise the error.

        Raises
        ------
        ParameterNotAccepted, ParameterMissing, LinkError, OperatorStopped
            The cause of the failure; everything is restored.
        NotAsFound
            The cause of the failure; some values could not be restored.
        """
        self.lend(values)
        for name, before, now in self._parameters.intrusions:
            if name in values and not self.written:
                raise PreconditionFailed(
                    f"another ground station wrote {name} = {now:g} (it was {before:g}), so the "
                    "experiments are no longer valid. Nothing was written. Start again"
                )
        try:
            for name, value in values.items():
                self._write(name, value)
        except (AutotuneError, KeyboardInterrupt) as error:
            self._give_back_after(error)
            raise

    def _write(self, name: str, value: float) -> None:
        self._journal.record("writing", name=name, value=value)
        if name in self.written:
            self.written.remove(name)
        self.written.append(name)
        self._parameters.write(name, value)
        self._left[name] = value
        self._journal.record("written", name=name, value=value)

    def _give_back_after(self, error: BaseException) -> None:
        try:
            self.give_back()
        except NotAsFound as failure:
            raise NotAsFound(f"{error}; and {failure}", differences=failure.differences) from error

    def keep(self) -> dict[str, float]:
        """Keep the new values after verifying them once more. Return name -> value.

        Raises
        ------
        ParameterNotAccepted
            A parameter no longer has the value written. Nothing is kept.
        """
        kept = self._parameters.read_confirmed(self.written)
        for name, value in kept.items():
            left = self._left[name]
            if not same_float32(value, left):
                raise ParameterNotAccepted(
                    f"{name} is {value:g}, but was tested with {left:g}: another station changed it",
                    name=name,
                    wanted=left,
                    found=value,
                )
        self._journal.record("kept", values=kept)
        self._release()
        return kept

    def give_back(self) -> None:
        """Restore every written parameter, last first, and verify the restored values. The operator cannot interrupt.

        If the vehicle has fallen silent, wait for it once. Values that another station has written since are kept.

        Raises
        ------
        NotAsFound
            Some values could not be restored; ``differences`` lists them with the reasons. The others are restored.
        """
        with self._session.operator.shielded():
            self._leave_overwritten()
            failures = self._put_back()
            if any(isinstance(error, LinkLost) for error in failures.values()) and self._session.outlast(_PATIENCE):
                failures = self._put_back()
        for name in self.written:
            if name not in failures:
                self._note_return(name)
        self.written = [name for name in self.written if name in failures]
        if failures:
            names = ", ".join(f"{name} (was {self.old[name]:g})" for name in failures)
            raise NotAsFound(
                f"could not restore {names}. The old values are in {self._journal.path}. "
                "Run `gcs-autotune restore` with this file once the vehicle answers again",
                differences={n: f"should be {self.old[n]:g}: {error}" for n, error in failures.items()},
            )
        self._release()

    def _leave_overwritten(self) -> None:
        """Keep the value that another station has written since, if the vehicle confirms it."""
        names = {name for name, _, _ in self._parameters.intrusions if name in self._left}
        try:
            held = self._parameters.read_confirmed(names) if names else {}
        except AutotuneError:
            return
        for name, value in held.items():
            if same_float32(value, self.old[name]) or same_float32(value, self._left[name]):
                continue
            self._session.notes.append(
                f"{name} stays at {value:g}, written by another station. Its original value is {self.old[name]:g}"
            )
            self.written.remove(name)
            with suppress(PreconditionFailed):  # a full disk: the journal only lists too much then
                self._journal.record("returned", name=name, value=value, by="another station")

    def _put_back(self) -> dict[str, AutotuneError]:
        """Write differing values and verify them, until none differs. Return those that failed."""
        failures: dict[str, AutotuneError] = {}
        owed = list(reversed(self.written))
        for _ in range(_ROUNDS):
            for name in owed:
                failures.pop(name, None)
                try:
                    self._parameters.write(name, self.old[name])
                except AutotuneError as error:
                    failures[name] = error
            if any(isinstance(error, LinkLost) for error in failures.values()):
                break
            failures |= self._looked_at([name for name in self.written if name not in failures])
            owed = [name for name, error in failures.items() if isinstance(error, (NoReply, _Changed))]
            if not owed:
                break
        return failures

    def _looked_at(self, names: list[str]) -> dict[str, AutotuneError]:
        """Read *names* again and return those that do not have the old value."""
        try:
            held = self._parameters.read_confirmed(names)
        except AutotuneError as error:
            return dict.fromkeys(names, error)
        changed = {n: v for n, v in held.items() if not same_float32(v, self.old[n])}
        return {n: _Changed(f"it changed to {v:g} again after it was restored") for n, v in changed.items()}

    def _note_return(self, name: str) -> None:
        """Record a restored value in the journal. A full disk must not stop the restore."""
        try:
            self._journal.record("returned", name=name, value=self.old[name])
        except PreconditionFailed as error:
            self._session.notes.append(f"{name} is restored, but this could not be written to the journal: {error}")

    def _release(self) -> None:
        self._parameters.unwatch(list(self.old))
        self.written.clear()
        self.old.clear()
        self._left.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self.written:
            self._release()
        elif error is None:
            self.give_back()
        else:
            self._give_back_after(error)
