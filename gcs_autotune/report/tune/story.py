"""The record of one tune, as far as it was completed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gcs_autotune.axes import AXES, OTHER_NAMES
from gcs_autotune.design import Change, Linearity, PositionMetrics, Proposal, StepMetrics, TrackMetrics
from gcs_autotune.identify import AxisFit
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Trial

__all__ = ["PLOTTED_SIGNALS", "PlottedSignals", "TuneStory"]


@dataclass(frozen=True, slots=True)
class PlottedSignals:
    """The signals plotted for a manoeuvre: position or velocity, its rate if it has one, and the actuator.

    ``unit``: SI unit of the position; ``noun``: common name of the signal.
    """

    position: str
    velocity: str
    force: str
    unit: str
    noun: str


PLOTTED_SIGNALS: Mapping[str, PlottedSignals] = {
    "psi": PlottedSignals("psi", "r", "N", "rad", "heading"),
    "z": PlottedSignals("z", "w", "Z", "m", "depth"),
    "phi": PlottedSignals("phi", "p", "K", "rad", "roll"),
    "theta": PlottedSignals("theta", "q", "M", "rad", "pitch"),
    "x": PlottedSignals("x", "u", "X", "m", "position ahead"),
    "y": PlottedSignals("y", "v", "Y", "m", "position abeam"),
    "u": PlottedSignals("u", "", "X", "m/s", "speed"),
    "r": PlottedSignals("r", "", "N", "rad/s", "turn rate"),
}
"""Signal of a manoeuvre -> the signals plotted with it, their unit and name."""


@dataclass(frozen=True, slots=True, eq=False)
class TuneStory:
    """One tune from its announcement to its ending; stages not reached are None or empty.

    Attributes
    ----------
    when : ISO 8601 moment, supplied by the caller (this module never reads a clock).
    vehicle : data of the vehicle: ``name, firmware, version, system_id, link, simulated`` and more.
    announced : the announcement, one line per entry.
    rates : message name -> (requested, measured rate) [Hz].
    beside : the turn-rate step flown with a heading step, with old and new gains.
    second_fit : the model of sway of a tune of the position, whose ``fit`` is that of surge.
    missions : the flights of a tune of the line.
    thrust_before, thrust_after : how thrust followed the command in a tune of the actuators.
    track_before, track_after : how they followed their route, with old and new parameters.
    stays : the steps and pushes of a tune of the position.
    position_before, position_after : how the position was held, with old and new gains.
    kept : whether the new gains stayed; None if undecided; ``verdict_reasons`` has the reasons.
    parameters_before, parameters_after : as read from the vehicle; empty if not read.
    events : (vehicle time [s] or NaN, what happened).
    ending : ``kept``, ``restored``, ``dry-run``, ``declined``, ``unchanged`` or ``aborted``; ``reason`` in words.
    way_on : how to continue after an early end, a sentence that ends with the command; empty if nothing can be reused.
    given : data of the model used for the design, if it came from a file instead of a fit.
    given_changes : changes by gains from a file, if none were designed.
    proving : the command that proves the gains of a file by the same step, without the file.
    doubts : doubts about the tune as a whole (the fit contains its own).
    directory : the run directory as the user typed it; ``files`` : names of its files (listed from disk if empty).
    """

    title: str
    when: str
    vehicle: Mapping[str, object]
    axis: str
    announced: tuple[str, ...] = ()
    rates: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    step_before: Trial | None = None
    relays: tuple[Trial, ...] = ()
    step_after: Trial | None = None
    fit: AxisFit | None = None
    second_fit: AxisFit | None = None
    given: Mapping[str, Any] | None = None
    proposal: Proposal | None = None
    given_changes: tuple[Change, ...] = ()
    proving: str = ""
    metrics_before: StepMetrics | None = None
    metrics_after: StepMetrics | None = None
    beside: tuple[StepMetrics, StepMetrics] | None = None
    missions: tuple[Trial, ...] = ()
    thrust_before: Linearity | None = None
    thrust_after: Linearity | None = None
    track_before: TrackMetrics | None = None
    track_after: TrackMetrics | None = None
    stays: tuple[Trial, ...] = ()
    position_before: PositionMetrics | None = None
    position_after: PositionMetrics | None = None
    kept: bool | None = None
    verdict_reasons: tuple[str, ...] = ()
    parameters_before: Mapping[str, float] = field(default_factory=dict)
    parameters_after: Mapping[str, float] = field(default_factory=dict)
    events: tuple[tuple[float, str], ...] = ()
    ending: str = "aborted"
    reason: str = ""
    way_on: str = ""
    doubts: tuple[str, ...] = ()
    directory: str = ""
    files: tuple[str, ...] = ()

    @property
    def dof(self) -> Dof:
        """The degree of freedom of the tuned axis."""
        kind = AXES.get(OTHER_NAMES.get(self.axis, self.axis))
        name = self.fit.dof if self.fit is not None else "yaw" if kind is None else kind.dof
        return DOFS[name]

    @property
    def stepped(self) -> PlottedSignals:
        """The signals plotted for the step before and after."""
        # A story may come from anywhere, with an axis that is none of ours.
        kind = AXES.get(OTHER_NAMES.get(self.axis, self.axis))
        signal = self.dof.position if kind is None else kind.stepped
        return PLOTTED_SIGNALS.get(signal, _plain(self.dof))

    @property
    def experiment_signals(self) -> PlottedSignals:
        """The signals plotted for the experiments: a boat's speed for throttle steps, else the position."""
        return next((self.signals_of(trial) for trial in self.relays if "signal" in trial.meta), self._of(self.dof))

    def signals_of(self, experiment: Trial) -> PlottedSignals:
        """Return the signals plotted for one *experiment*. A tune of the position flies one per direction."""
        if experiment.meta.get("signal") == "u":
            return PLOTTED_SIGNALS["u"]
        return self._of(DOFS.get(str(experiment.meta.get("dof")), self.dof))

    @staticmethod
    def _of(dof: Dof) -> PlottedSignals:
        return PLOTTED_SIGNALS.get(dof.position, _plain(dof))

    @property
    def changes(self) -> tuple[Change, ...]:
        """Changes of the gains, proposed by the design or supplied by a file: old and new values."""
        return self.given_changes if self.proposal is None else self.proposal.changes

    @property
    def awaits_proof(self) -> bool:
        """Whether gains were designed but not yet tested on the vehicle."""
        designed = self.proposal is not None and bool(self.proposal.changes)
        return designed and self.kept is None and self.metrics_after is None and self.ending != "unchanged"

    @property
    def differences(self) -> Mapping[str, tuple[float, float]]:
        """Parameter -> (value before, value after) of all that differ; empty unless both sets were read."""
        after = self.parameters_after
        return {
            name: (old, after[name])
            for name, old in self.parameters_before.items()
            if name in after and after[name] != old
        }


def _plain(dof: Dof) -> PlottedSignals:
    return PlottedSignals(dof.position, dof.velocity, dof.force, dof.position_unit, dof.position)
