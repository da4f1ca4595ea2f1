"""Resume a run that ended early. Its completed trials are reused if nothing has changed since.

A trial is valid for one vehicle with one set of parameters. So the board (or the fingerprint), the firmware and the
parameters must be the recorded ones; axis and settings must be those of that run. The sign check and the dive, which
make a flight safe, are always flown again.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from gcs_autotune.documents import SETTING_OUT, SettingOut, load_setting_out
from gcs_autotune.errors import GuardTripped, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.link import Journal, MavlinkCraft, difference, fingerprint_of, same_float32
from gcs_autotune.manoeuvres import GUARDS
from gcs_autotune.trial import Trial, load_trial
from gcs_autotune.workflow.record import JOURNAL, RunDirectory
from gcs_autotune.workflow.settings import CommonSettings, TuneSettings

__all__ = ["USED_AGAIN", "Earlier", "note_setting_out", "same_options", "way_on"]

USED_AGAIN = ("step-before", "relay-1", "relay-2", "throttle-1", "throttle-2")
"""Trials that a later run may reuse."""
_SHAPING = (
    *("axis", "step", "step_duration", "relay_output", "relay_hysteresis", "throttle", "speed", "control_rate"),
    *("full_scale", "stop_rule"),
)
"""Settings that determine what is flown."""


def _shape(settings: CommonSettings) -> dict[str, Any]:
    shape = {name: getattr(settings, name) for name in _SHAPING if hasattr(settings, name)}
    return {**shape, "given": settings.given is not None} if isinstance(settings, TuneSettings) else shape


def note_setting_out(
    record: RunDirectory, settings: CommonSettings, craft: MavlinkCraft, own: Mapping[str, float]
) -> None:
    """Save, before anything moves, the state that a run resuming this one must match."""
    vehicle = craft.session.vehicle
    record.save_json(
        SETTING_OUT,
        {
            "settings": _shape(settings),
            "vehicle": vehicle.to_dict() if vehicle is not None else {},
            "fingerprint": fingerprint_of(craft.parameters),
            "parameters": dict(own),
        },
    )


def same_options(error: BaseException) -> str:
    """Return a sentence on the options with which to continue after *error*. A limit that ended the run must be
    changed.
    """
    tripped = error.guard if isinstance(error, GuardTripped) else ""
    option = next((guard.option for guard in GUARDS if guard.name == tripped), "")
    return f"change --{option} and keep the other options" if option else "use the same options"


def way_on(settings: TuneSettings, finished: list[str], error: BaseException) -> str:
    """Return a sentence on how to continue after *error* from the *finished* trials of a run; empty if none can be
    reused."""
    kept = [name for name in USED_AGAIN if name in finished]
    if not kept:
        return ""
    link, run = shlex.quote(settings.connection.uri), shlex.quote(str(settings.directory))
    return (
        f"these records of the run can be used again: {', '.join(kept)}. To continue from there, "
        f"{same_options(error)}: gcs-autotune tune {settings.axis} --connect {link} --resume {run}"
    )


class Earlier:
    """Completed trials called *names* of an earlier run (``settings.resume``), to be reused; none without such a run.

    alike : whether the settings must be the same, because the earlier trials replace those of this run.

    Raises
    ------
    UsageError
        The earlier run cannot be resumed, or was flown with other settings.
    PreconditionFailed
        The earlier run has not restored everything on its vehicle.
    BadFile
        The earlier run cannot be read.
    """

    def __init__(self, settings: CommonSettings, names: Sequence[str] = USED_AGAIN, *, alike: bool = True) -> None:
        self._run = settings.resume
        self._names = names
        self._start = SettingOut()
        self._trials: dict[str, Trial] = {}
        if self._run is None:
            return
        if not (self._run / SETTING_OUT).exists():
            raise UsageError(
                f"{self._run} cannot be resumed: it contains no {SETTING_OUT}. Start again without --resume"
            )
        self._start = load_setting_out(self._run)
        if alike:
            self._check_settings(_shape(settings))
        journal = self._run / JOURNAL
        if journal.exists() and not Journal.read(journal).is_settled:
            raise PreconditionFailed(
                f"{self._run} has not restored everything. First run `gcs-autotune restore "
                f"{shlex.quote(str(self._run))}`"
            )
        for path in sorted((self._run / "trials").glob("*.csv")):
            if path.stem.partition("-")[2] in names:
                trial = load_trial(path)
                if trial.ending == "completed":
                    self._trials[trial.name] = trial

    def _check_settings(self, wanted: Mapping[str, Any]) -> None:
        then = self._start.settings
        other = [name for name, value in wanted.items() if then.get(name) != value]
        if other:
            shown = ", ".join(
                f"{n.replace('_', '-')} {_or_unset(then.get(n))} then, {_or_unset(wanted[n])} now" for n in other
            )
            raise UsageError(
                f"{self._run} was flown with other settings ({shown}). Use the same settings, or omit --resume"
            )

    @property
    def names(self) -> list[str]:
        """Names of the trials that may be reused."""
        return [name for name in self._names if name in self._trials]

    def take(self, name: str) -> Trial | None:
        """Return the completed trial called *name*, once; None if there is none or it was already returned."""
        return self._trials.pop(name, None)

    def has(self, name: str) -> bool:
        """Return whether :meth:`take` would return a trial of that name."""
        return name in self._trials

    def verify_same_vehicle(self, craft: MavlinkCraft, own: Mapping[str, float]) -> None:
        """Check that the vehicle and its parameters match those of the earlier run (*own*: name -> present value).

        Raises
        ------
        WrongVehicle, PreconditionFailed
            It is another vehicle, or its parameters differ.
        """
        if self._run is None:
            return
        here = craft.session.vehicle
        assert here is not None
        then = self._start.vehicle
        strange = difference(then, self._start.fingerprint, here, craft.parameters)
        if not strange and then.get("version") != here.version:
            strange = f"its firmware was {then.get('version') or 'unknown'} then and is {here.version or 'unknown'} now"
        if strange:
            raise WrongVehicle(f"{self._run} was flown by another vehicle ({strange}). Start again without --resume")
        held = self._start.parameters
        other = [n for n in held.keys() | own.keys() if not _same(held.get(n), own.get(n))]
        if other:
            shown = ", ".join(f"{n} {held.get(n, 'absent')} then, {own.get(n, 'absent')} now" for n in sorted(other))
            raise PreconditionFailed(
                f"the vehicle's parameters have changed since {self._run} was flown ({shown}), so its "
                "experiments are not valid now. Restore the parameters, or start again without --resume"
            )


def _or_unset(value: object) -> object:
    return "unset" if value is None else value


def _same(a: float | None, b: float | None) -> bool:
    return a is not None and b is not None and same_float32(float(a), float(b))
