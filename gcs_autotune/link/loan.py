"""Borrowing parameters: the old values are on disk first, and go back in reverse order unless kept."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import Self

from gcs_autotune.errors import AutotuneError, NotAsFound, PreconditionFailed
from gcs_autotune.link.journal import Journal
from gcs_autotune.link.parameters import Parameters

__all__ = ["ParameterLoan"]


class ParameterLoan:
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

    def lend(self, names: Iterable[str]) -> dict[str, float]:
        """Read and journal the values of *names* as found; return them.

        Raises
        ------
        ParameterMissing
            One of them does not exist; then none is lent.
        PreconditionFailed
            The journal cannot be written.
        """
        wanted = list(dict.fromkeys(names))
        new = self._parameters.read_all([name for name in wanted if name not in self.old])
        for name, value in new.items():
            self._journal.record("lent", name=name, value=value)
            self.old[name] = value
        self._parameters.watch(new)
        return {name: self.old[name] for name in wanted}

    def set(self, values: Mapping[str, float]) -> None:
        """Write all of *values*, or, on any failure, put everything back as found and raise.

        Raises
        ------
        ParameterNotAccepted, ParameterMissing, LinkError, OperatorStopped
            What went wrong; everything is as found.
        NotAsFound
            What went wrong, and not everything could be put back.
        """
        self.lend(values)
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
        self._journal.record("written", name=name, value=value)

    def _give_back_after(self, error: BaseException) -> None:
        try:
            self.give_back()
        except NotAsFound as failure:
            raise NotAsFound(f"{error}; and {failure}", differences=failure.differences) from error

    def keep(self) -> dict[str, float]:
        """Leave the new values in the vehicle for good; return them."""
        kept = {name: self._parameters.known[name] for name in self.written}
        self._journal.record("kept", values=kept)
        self._release()
        return kept

    def give_back(self) -> None:
        """Put every written parameter back as found, last first, each verified. The operator has to wait.

        Raises
        ------
        NotAsFound
            When some could not be put back; ``differences`` says which and why. The others are back.
        """
        failures: dict[str, str] = {}
        with self._session.shielded():
            for name in reversed(self.written):
                try:
                    self._parameters.write(name, self.old[name])
                except AutotuneError as error:
                    failures[name] = f"should be {self.old[name]:g}: {error}"
                else:
                    self._note_return(name)
        self.written = [name for name in self.written if name in failures]
        if failures:
            names = ", ".join(f"{name} (was {self.old[name]:g})" for name in failures)
            raise NotAsFound(
                f"could not put back {names}; the old values are in {self._journal.path}: "
                "run `gcs-autotune restore` with it when the vehicle answers again",
                differences=failures,
            )
        self._release()

    def _note_return(self, name: str) -> None:
        """A journal that has become unwritable must not stop us from giving back; it only says too much then."""
        try:
            self._journal.record("returned", name=name, value=self.old[name])
        except PreconditionFailed as error:
            self._session.notes.append(f"{name} is back, but the journal does not say so: {error}")

    def _release(self) -> None:
        self._parameters.unwatch(list(self.old))
        self.written.clear()
        self.old.clear()

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
