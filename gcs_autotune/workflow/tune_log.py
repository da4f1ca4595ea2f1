"""Events of a tune, collected as they happen, so that a report can be written after any ending."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs_autotune.design import Change, Linearity, PositionMetrics, Proposal, StepMetrics, TrackMetrics
from gcs_autotune.identify import AxisFit
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.observer import Intentions, Observer, Progress
from gcs_autotune.report import TuneStory
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.itinerary import MissionLog
from gcs_autotune.workflow.settings import TuneSettings

__all__ = ["TuneLog"]

POSITION_KINDS = ("step-position", "push-position")
"""Manoeuvres of a tune of the position."""


class TuneLog(MissionLog):
    """An observer that stores everything and forwards it to the user's observer."""

    def __init__(self, settings: TuneSettings, when: str, observer: Observer, axis: str = "") -> None:
        super().__init__(observer)
        self._settings = settings
        self._axis = axis or settings.axis
        self._when = when
        self._t = math.nan
        self._events: list[tuple[float, str]] = []
        self._trials: list[Trial] = []
        self._vehicle: dict[str, object] = {"link": settings.connection.uri}
        self._rates: dict[str, tuple[float, float]] = {}
        self._craft: MavlinkCraft | None = None
        self._announced: tuple[str, ...] = ()
        self._ending, self._reason = "aborted", "the run did not start"
        self.fit: AxisFit | None = None
        self.second_fit: AxisFit | None = None
        self.proposal: Proposal | None = None
        self.given_changes: tuple[Change, ...] = ()
        self.metrics_before: StepMetrics | None = None
        self.metrics_after: StepMetrics | None = None
        self.beside: tuple[StepMetrics, StepMetrics] | None = None
        self.thrust_before: Linearity | None = None
        self.thrust_after: Linearity | None = None
        self.track_before: TrackMetrics | None = None
        self.track_after: TrackMetrics | None = None
        self.position_before: PositionMetrics | None = None
        self.position_after: PositionMetrics | None = None
        self.verdict: tuple[bool | None, tuple[str, ...]] = (None, ())
        self.parameters_before: dict[str, float] = {}
        self.parameters_after: dict[str, float] = {}

    def update(self, progress: Progress) -> None:
        """Store the vehicle's time, and forward the progress at a control tick."""
        self._t = progress.t
        super().update(progress)

    def say(self, text: str) -> None:
        """Store an event with the vehicle's time, and forward it."""
        self._events.append((self._t, text))
        super().say(text)

    def meet(self, craft: MavlinkCraft) -> None:
        """Store the vehicle's identity and its telemetry rates."""
        self._craft = craft
        transport, vehicle = craft.session.transport, craft.session.vehicle
        self._vehicle = {
            **({"name": str(vehicle), **vehicle.to_dict()} if vehicle is not None else {}),
            "link": transport.description,
            "simulated": transport.is_simulated,
        }
        self._rates = {
            name: (granted.requested, craft.rates.measured.get(name, math.nan))
            for name, granted in craft.rates.granted.items()
        }

    def announce(self, intentions: Intentions) -> None:
        """Store the announcement of what the tune will do, before anything moves, and forward it."""
        self._announced = intentions.texts
        super().announce(intentions)

    def parameter_types(self) -> tuple[dict[str, int], tuple[int, int]]:
        """Return (parameter -> MAV_PARAM_TYPE, (system id, component id) of the vehicle)."""
        if self._craft is None or self._craft.session.vehicle is None:
            return {}, (1, 1)
        vehicle = self._craft.session.vehicle
        return self._craft.parameters.types, (vehicle.system, vehicle.component)

    def flown(self, trial: Trial) -> None:
        """Store a completed trial. A repeated trial replaces the interrupted one."""
        self._trials = [*(t for t in self._trials if t.name != trial.name), trial]

    def say_ending(self, trial: Trial) -> None:
        """Report how *trial* ended. The error that ends the run contains the reason of an aborted one."""
        reason = "" if trial.ending == "aborted" else f", {trial.reason}"
        self.say(f"{trial.name}: {trial.ending}{reason} ({trial.duration:.0f} s recorded)")

    @property
    def finished(self) -> list[str]:
        """Names of the completed trials of the tune, in their order."""
        return [trial.name for trial in self._trials if trial.ending == "completed"]

    def end(self, ending: str, reason: str) -> None:
        """Store how the tune ended."""
        self._ending, self._reason = ending, reason
        self.say(reason)

    def abort(self, error: BaseException) -> None:
        """Store the reason why the tune ended early."""
        self._ending, self._reason = "aborted", str(error) or type(error).__name__
        self._events.append((self._t, f"aborted: {self._reason}"))

    def relay_speed(self) -> float:
        """Return the mean speed over ground [m/s] during the relay experiments; 0 when unknown."""
        return self.speed_of(self._relays())

    @staticmethod
    def speed_of(trials: Sequence[Trial]) -> float:
        """Return the mean speed over ground [m/s] of *trials*; 0 when unknown."""
        speeds = [float(np.mean(t["U"].values)) for t in trials if "U" in t and len(t["U"])]
        return float(np.mean(speeds)) if speeds else 0.0

    def story(self) -> TuneStory:
        """Return the record of the tune so far."""
        s = self._settings
        kept, reasons = self.verdict
        return TuneStory(
            title=f"tune {self._axis}",
            when=self._when,
            vehicle={**self._vehicle, **self._link_times()},
            axis=self._axis,
            announced=self._announced,
            rates=self._rates,
            step_before=self._trial("step-before"),
            relays=tuple(self._relays()),
            step_after=self._trial("step-after"),
            fit=self.fit,
            second_fit=self.second_fit,
            given=None if s.given is None else s.given.model.to_dict(),
            proposal=self.proposal,
            given_changes=self.given_changes,
            proving=s.proving,
            metrics_before=self.metrics_before,
            metrics_after=self.metrics_after,
            beside=self.beside,
            missions=tuple(t for t in self._trials if t.meta.get("manoeuvre") == "mission"),
            thrust_before=self.thrust_before,
            thrust_after=self.thrust_after,
            track_before=self.track_before,
            track_after=self.track_after,
            stays=tuple(t for t in self._trials if t.meta.get("manoeuvre") in POSITION_KINDS),
            position_before=self.position_before,
            position_after=self.position_after,
            kept=kept,
            verdict_reasons=reasons,
            parameters_before=self.parameters_before,
            parameters_after=self.parameters_after,
            events=tuple(self._events),
            ending=self._ending,
            reason=self._reason,
            way_on=self.way_on,
            directory=str(s.directory),
        )

    def _link_times(self) -> dict[str, object]:
        """Return the delays on the link, as a sentence and as numbers [s]."""
        if self._craft is None:
            return {}
        times = self._craft.link_times
        return {"link_times": str(times), "link_seconds": times.to_dict()}

    def _relays(self) -> list[Trial]:
        return [t for t in self._trials if t.purpose == "identification"]

    def _trial(self, name: str) -> Trial | None:
        return next((t for t in self._trials if t.name == name), None)
