"""Temporary parameter changes: old values are saved to disk first and restored in reverse order unless kept."""

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
"""Seconds to wait for a silent vehicle before restoring fails. Chosen: a boat may be behind a pier."""
_ROUNDS = 3
"""Rounds of restoring and verifying. Chosen: a delayed write of ours may arrive after the old value was restored."""


class _Changed(AutotuneError):
    """The parameter changed after it was restored: by a delayed write of ours, or by another station."""


class ParameterTransaction:
    """Parameters in our hands for a while.

    As a context manager it gives everything back on leaving, unless :meth:`keep` was called.

    Attributes
    ----------
    old : name -> the value as found, of everything lent.
    written : names written and not yet kept or given back, in order.
    """

    def __init__(self, parameters: Parameters, journal: Journal) -> None:
        self._session = parameters.session
        self._parameters = parameters
        self._journal = journal
        self.old: dict[str, float] = {}
        self.written: list[str] = []
        self._left: dict[str, float] = {}

    def lend(self, names: Iterable[str]) -> dict[str, float]:
        """Read and journal the original values of *names*; return them.

        Raises
        ------
        ParameterMissing, TelemetryFault
            One of them does not exist, or is answered with contradicting values; then none is lent.
        PreconditionFailed
            One holds what could not be put back (not a number), or the journal cannot be written.
        """
        wanted = list(dict.fromkeys(names))
        new = checked_all(self._parameters.read_confirmed([name for name in wanted if name not in self.old]))
        for name, value in new.items():
            self._journal.record("lent", name=name, value=value)
            self.old[name] = value
        self._parameters.watch(new)
        return {name: self.old[name] for name in wanted}

    def set(self, values: Mapping[str, float]) -> None:
        """Write all of *values*; on any failure restore everything and raise.

        Raises
        ------
        ParameterNotAccepted, ParameterMissing, LinkError, OperatorStopped
            What went wrong; everything is as found.
        NotAsFound
            What went wrong, and not everything could be put back.
        """
        self.lend(values)
        for name, before, now in self._parameters.intrusions:
            if name in values and not self.written:
                raise PreconditionFailed(
                    f"another ground station wrote {name} = {now:g} (it was {before:g}), so the "
                    "experiments are not valid for it. Nothing was written. Start again"
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
        """Keep the new values, after verifying them once more; return them.

        Raises
        ------
        ParameterNotAccepted
            It no longer holds what was written; nothing is kept.
        """
        kept = self._parameters.read_confirmed(self.written)
        for name, value in kept.items():
            left = self._left[name]
            if not same_float32(value, left):
                raise ParameterNotAccepted(
                    f"{name} is {value:g}, but was proved with {left:g}: another station changed it",
                    name=name,
                    wanted=left,
                    found=value,
                )
        self._journal.record("kept", values=kept)
        self._release()
        return kept

    def give_back(self) -> None:
        """Put every written parameter back as found, last first, and read them all again. The operator has to wait.

        A vehicle that has fallen silent is waited for once. What another station has written meanwhile stands.

        Raises
        ------
        NotAsFound
            When some could not be put back; ``differences`` says which and why. The others are back.
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
                "Run `gcs-autotune restore` with it once the vehicle answers again",
                differences={n: f"should be {self.old[n]:g}: {error}" for n, error in failures.items()},
            )
        self._release()

    def _leave_overwritten(self) -> None:
        """Keep what another station has written since, if the vehicle confirms it."""
        names = {name for name, _, _ in self._parameters.intrusions if name in self._left}
        try:
            held = self._parameters.read_confirmed(names) if names else {}
        except AutotuneError:
            return
        for name, value in held.items():
            if same_float32(value, self.old[name]) or same_float32(value, self._left[name]):
                continue
            self._session.notes.append(
                f"{name} stays at {value:g}, written by another station; its original value is {self.old[name]:g}"
            )
            self.written.remove(name)
            with suppress(PreconditionFailed):  # a full disk: the journal only says too much then
                self._journal.record("returned", name=name, value=value, by="another station")

    def _put_back(self) -> dict[str, AutotuneError]:
        """Write differing values and verify, until none differs; return what failed."""
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
        """Read *names* again and return those without the old value."""
        try:
            held = self._parameters.read_confirmed(names)
        except AutotuneError as error:
            return dict.fromkeys(names, error)
        changed = {n: v for n, v in held.items() if not same_float32(v, self.old[n])}
        return {n: _Changed(f"it changed to {v:g} again after it was restored") for n, v in changed.items()}

    def _note_return(self, name: str) -> None:
        """Record a restored value; a full disk must not stop the restore."""
        try:
            self._journal.record("returned", name=name, value=self.old[name])
        except PreconditionFailed as error:
            self._session.notes.append(f"{name} is restored, but the journal could not record it: {error}")

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
