"""A form with effects, simulated with sensitivities.

A run is simulated in these stages: stamps -> ``retime`` -> commands -> ``drive`` -> equations of motion -> ``observe``
-> predicted columns. The equations of motion are the base form with the effects' ``derivatives``. The sensitivities to
the base model's parameters, to initial states, and to effects that act through derivatives are exact, apart from the
sensors. The other sensitivities are difference quotients.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.documents import conformed
from gcs_autotune.effects.effect import Drive, EffectInstance, Observed
from gcs_autotune.effects.table import EFFECTS
from gcs_autotune.effects.track import along_heading
from gcs_autotune.errors import BadFile
from gcs_autotune.models import CoupledModel, Form, Simulator
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Channel
from gcs_autotune_files.model import CoupledData, ExtendedData

__all__ = ["SCHEMA", "STEP", "ExtendedModel", "ExtendedSimulator", "Passage", "in_order", "passage_of"]

Array = NDArray[np.float64]


Index = NDArray[np.int64]

STEP = 1e-3
"""Step of difference quotients, relative to a parameter's typical size. Project choice."""

NUDGE = 1e-4
"""Relative step of the difference quotients that pass sensitivities through sensors. Project choice."""

PATIENCE = 70
"""Number of integration steps per stamp above which a simulation is abandoned. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Passage(Displayed):
    """One stretch of a run, in the format for simulations.

    - ``t_in`` (j,): stamps of the inputs [s].
    - ``commands[name]`` (j,): inputs, each value held until the next stamp.
    - ``stamps`` (s,): all stamps of all signals [s].
    - ``at[signal]`` (n,): indices in ``stamps`` of that signal's stamps.
    - ``measured``: name -> recorded channel of the run.
    """

    run: str
    t_in: Array
    commands: Mapping[str, Array]
    stamps: Array
    at: Mapping[str, Index]
    start: float
    measured: Mapping[str, Channel] = field(default_factory=dict)


def in_order(effects: Sequence[EffectInstance]) -> tuple[EffectInstance, ...]:
    """Return *effects* in the order of the table of effects, which is the order in which they act."""
    order = list(EFFECTS)
    return tuple(sorted(effects, key=lambda e: (order.index(e.slug), e.place)))


def passage_of(
    run: str,
    t_in: Array,
    commands: Mapping[str, Array],
    stamps: Mapping[str, Array],
    measured: Mapping[str, Channel] | None = None,
) -> Passage:
    """Return a passage with the inputs *commands* and the *stamps* of every signal."""
    together = np.unique(np.concatenate(list(stamps.values())))
    at = {n: np.searchsorted(together, t).astype(np.int64) for n, t in stamps.items()}
    begin = float(min(together[0], t_in[0])) if len(t_in) else float(together[0])
    return Passage(run, t_in, commands, together, at, begin, measured or {})


@dataclass(frozen=True, slots=True, eq=False)
class _Simulated:
    """A run simulated from ``theta``, ``effects`` and ``x_0``: the true signals and those ``seen`` by the sensors.

    ``by``: sensitivities (s, q) of the seen signals to the simulator's parameters and initial states.
    """

    theta: Array
    effects: Sequence[EffectInstance]
    x_0: Array
    passage: Passage
    truth: Observed
    seen: Observed
    by: Mapping[str, Array]


class ExtendedSimulator:
    """Simulator of a form with effects.

    Parameters
    ----------
    form : form of the base model.
    effects : effects with slugs and places. Their values may change between simulations.
    free : names of the base parameters for which sensitivities are calculated.
    free_effects : ``(index, parameter)`` of the effects' parameters for which sensitivities are calculated.
    free_states : names of the initial states for which sensitivities are calculated. The columns of a Jacobian are in
        the order of *free*, *free_effects* and *free_states*.
    typical : typical size of each element of *free_effects*, for difference quotients.
    """

    def __init__(
        self,
        form: Form,
        effects: Sequence[EffectInstance] = (),
        free: Sequence[str] = (),
        free_effects: Sequence[tuple[int, str]] = (),
        free_states: Sequence[str] = (),
        typical: Sequence[float] | None = None,
    ) -> None:
        self.base = form
        self.entries = tuple(EFFECTS[e.slug] for e in effects)
        order = sorted(range(len(self.entries)), key=lambda i: (self.entries[i].family == "data errors", i))
        self._sensors = tuple(i for i in order if "sensors" in self.entries[i].acts_on)
        self.free = tuple(free)
        self.free_effects = tuple(free_effects)
        self.free_states = tuple(free_states)
        self.typical = tuple(typical) if typical is not None else tuple(1.0 for _ in free_effects)
        added: dict[str, None] = {}
        more: dict[str, None] = {}
        for entry, instance in zip(self.entries, effects, strict=True):
            added.update(dict.fromkeys(entry.derivatives(instance)))
            more.update(dict.fromkeys(entry.inputs(instance)))
        self.added = tuple(added)
        extended = replace(form, inputs={**form.inputs, **{n: () for n in more if n not in form.inputs}})
        self.form = extended.freeing(*(n for n in added if n not in form.parameters)) if added else extended
        self._at = {n: k for k, n in enumerate(self.form.parameters)}
        self._of_base = [self._at[n] for n in form.parameters]
        wanted = dict.fromkeys((*self.free, *(self.added if self.free_effects else ())))
        self._columns = tuple(wanted)
        self._simulator = Simulator(self.form, self._columns, self.free_states, patience=PATIENCE)
        self._stages = tuple(self._stage(i) for i, _ in self.free_effects)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in the order of the state vector."""
        return self._simulator.states

    def _stage(self, i: int) -> str:
        """Return the stage where a parameter acts: through derivatives only, at the sensors only, or before the
        simulation."""
        entry = self.entries[i]
        if entry.acts_on & {"clock", "commands"}:
            return "before"
        if "motion" in entry.acts_on:
            return "before" if "sensors" in entry.acts_on else "within"
        return "after"

    def run(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        x_0: Array,
        passage: Passage,
        *,
        sensitivities: bool = False,
    ) -> dict[str, tuple[Array, Array]] | None:
        """Return name of the signal -> values (n,) at its stamps and Jacobian (n, q), or None if the motion diverges.

        theta : (p,) base parameters in the order of ``form.parameters``.
        x_0 : (n,) state at the first stamp.

        The Jacobian is (n, 0) without *sensitivities*.
        """
        moved = self._move(theta, effects, x_0, passage, sensitivities)
        if moved is None:
            return None
        truth, by = moved
        seen = self._observe(effects, truth)
        if not sensitivities:
            predicted = {n: (seen.signals[n][at], np.empty((len(at), 0))) for n, at in passage.at.items()}
            return self._steered(effects, predicted, passage)
        passed = self._through_sensors(effects, truth, seen, by)
        run = _Simulated(theta, effects, x_0, passage, truth, seen, passed)
        columns = []
        for k, (i, name) in enumerate(self.free_effects):
            found = self._effect_column(k, i, name, run)
            if found is None:
                return None
            columns.append(found)
        within, states = len(self.free), len(self._columns)
        predicted = {
            n: (
                seen.signals[n][at],
                np.hstack([passed[n][at, :within], *(c[n][at, None] for c in columns), passed[n][at, states:]]),
            )
            for n, at in passage.at.items()
        }
        return self._steered(effects, predicted, passage)

    def truth(self, theta: Array, effects: Sequence[EffectInstance], x_0: Array, passage: Passage) -> Observed | None:
        """Return all true signals at all stamps, or None if the motion diverges.

        :meth:`seen` applies sensors to them.
        """
        moved = self._move(theta, effects, x_0, passage, False, everything=True)
        return None if moved is None else moved[0]

    def seen(self, effects: Sequence[EffectInstance], truth: Observed, passage: Passage) -> dict[str, Array]:
        """Return name of the signal -> values (n,) at its stamps, as the sensors of *effects* report the true
        signals *truth*.
        """
        seen = self._observe(effects, truth)
        predicted = {n: (seen.signals[n][at], np.empty((len(at), 0))) for n, at in passage.at.items()}
        return {n: y for n, (y, _) in self._steered(effects, predicted, passage).items()}

    def _steered(
        self, effects: Sequence[EffectInstance], predicted: dict[str, tuple[Array, Array]], passage: Passage
    ) -> dict[str, tuple[Array, Array]]:
        """Return *predicted* with the track along the measured heading, if a disturbance turns the craft."""
        turned = any(entry.turns(e) for entry, e in zip(self.entries, effects, strict=True))
        heading = passage.measured.get("psi")
        if not turned or heading is None or not {"x", "y", "psi"} <= set(passage.at):
            return predicted
        if not np.array_equal(passage.at["x"], passage.at["y"]):
            return predicted
        x, y, psi = (predicted[n] for n in ("x", "y", "psi"))
        stamps = {n: passage.stamps[passage.at[n]] for n in ("x", "psi")}
        return predicted | along_heading((x, y), psi, stamps["x"], stamps["psi"], heading)

    def extended_theta(self, theta: Array, effects: Sequence[EffectInstance]) -> Array:
        """Return the parameters (e,) of the extended form: the base parameters *theta* and the derivatives of
        *effects*.
        """
        found = np.zeros(len(self._at))
        found[self._of_base] = theta
        for entry, instance in zip(self.entries, effects, strict=True):
            for name, value in entry.derivatives(instance).items():
                found[self._at[name]] += value
        return found

    def _move(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        x_0: Array,
        passage: Passage,
        sensitivities: bool,
        *,
        everything: bool = False,
    ) -> tuple[Observed, dict[str, Array]] | None:
        """Return the true signals at all stamps, and their sensitivities (s, q) to the simulator's parameters."""
        t_in, stamps, start = passage.t_in, passage.stamps, passage.start
        for entry, instance in zip(self.entries, effects, strict=True):
            if "clock" in entry.acts_on:
                t_in = entry.retime(instance, t_in, start, inputs=True)
                stamps = entry.retime(instance, stamps, start, inputs=False)
        drive = Drive(t_in, passage.commands, start, passage.measured, passage.run)
        for entry, instance in zip(self.entries, effects, strict=True):
            drive = entry.drive(instance, drive)
        inputs = [drive.channels[n] for n in self.form.inputs]
        table = np.column_stack(inputs) if inputs else np.zeros((len(drive.t), 0))
        extended = self.extended_theta(theta, effects)
        found = self._simulator.run(extended, x_0, drive.t, table, stamps, sensitivities=sensitivities)
        if found is None:
            return None
        X, S = found
        signals, by = {}, {}
        for name in self._wanted(passage, everything):
            signals[name], by[name] = self._simulator.outputs(extended, X, S, name)
        return Observed(passage.stamps, signals, start, passage.run), by

    def _wanted(self, passage: Passage, everything: bool) -> list[str]:
        """Return the signals to calculate: the measured ones, or all if a sensor may mix them."""
        if everything or any("sensors" in entry.acts_on for entry in self.entries):
            return [n for n in self.states if not n.startswith("lagged")]
        return list(passage.at)

    def _observe(self, effects: Sequence[EffectInstance], truth: Observed) -> Observed:
        for i in self._sensors:
            truth = self.entries[i].observe(effects[i], truth)
        return truth

    def _through_sensors(
        self, effects: Sequence[EffectInstance], truth: Observed, seen: Observed, by: Mapping[str, Array]
    ) -> Mapping[str, Array]:
        """Return the sensitivities (s, q) of every signal after the sensors."""
        if not self._sensors:
            return by
        passed = {n: np.zeros((len(seen.t), len(self._columns) + len(self.free_states))) for n in seen.signals}
        for j in range(len(self._columns) + len(self.free_states)):
            size = max((float(np.abs(c[:, j]).max()) for c in by.values()), default=0.0)
            if size == 0.0:
                continue
            h = NUDGE / size
            nudged = self._observe(
                effects, replace(truth, signals={n: y + h * by[n][:, j] for n, y in truth.signals.items()})
            )
            for n, y in seen.signals.items():
                passed[n][:, j] = (nudged.signals[n] - y) / h
        return passed

    def _effect_column(
        self,
        k: int,
        i: int,
        name: str,
        run: _Simulated,
    ) -> Mapping[str, Array] | None:
        """Return the sensitivity of every signal to parameter *name* of effect *i*, the *k*-th free parameter."""
        effects, seen, by = run.effects, run.seen, run.by
        instance, entry = effects[i], self.entries[i]
        h = STEP * self.typical[k]
        nudged = instance.with_values({name: instance.values[name] + h})
        if self._stages[k] == "within":
            before, after = entry.derivatives(instance), entry.derivatives(nudged)
            weights = {n: (after[n] - before[n]) / h for n in before}
            total: dict[str, Array] = {n: np.zeros(len(seen.t)) for n in seen.signals}
            for derivative, weight in weights.items():
                if weight != 0.0:
                    column = self._columns.index(derivative)
                    for n in total:
                        total[n] = total[n] + weight * by[n][:, column]
            return total
        changed = [*effects[:i], nudged, *effects[i + 1 :]]
        if self._stages[k] == "after":
            moved: tuple[Observed, dict[str, Array]] | None = (run.truth, {})
        else:
            moved = self._move(run.theta, changed, run.x_0, run.passage, False)
        if moved is None:
            return None
        other = self._observe(changed, moved[0])
        return {n: (other.signals[n] - y) / h for n, y in seen.signals.items()}


SCHEMA = 1


@dataclass(frozen=True, slots=True)
class ExtendedModel(Displayed):
    """A coupled model with the effects between it and the measurements, in the order of the table of effects.

    - ``amplitude``: full output of each input in the units of the runs (:attr:`.effect.DataSummary.full`), empty if
      unknown.
    - ``units``: units of the inputs ("1": fractions of full output), empty if unknown.
    """

    base: CoupledModel
    effects: tuple[EffectInstance, ...] = ()
    amplitude: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as data for a model file."""
        return {
            "schema": SCHEMA,
            "model": "extended",
            "base": self.base.to_dict(),
            "effects": [e.to_dict() for e in self.effects],
            "constants": {"swing": dict(self.amplitude), "units": dict(self.units)},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ExtendedModel:
        """Return the model that :meth:`to_dict` wrote as *data*, or that *data* of a plain coupled model describes.

        Raises
        ------
        BadFile
            Something is missing or of the wrong kind.
        UnknownName
            An effect is not in the table.
        """
        contents: CoupledData | ExtendedData = conformed(data, CoupledData | ExtendedData, "model")  # type: ignore[arg-type]
        return cls.of_data(contents)

    @classmethod
    def of_data(cls, contents: CoupledData | ExtendedData) -> ExtendedModel:
        """Return the model described by the *contents* of a model file.

        Exceptions are those of :meth:`from_dict`.
        """
        if isinstance(contents, CoupledData):
            return cls(CoupledModel.of_data(contents))
        base = CoupledModel.of_data(contents.base)
        effects = tuple(
            _as_now(EffectInstance(e.slug, e.place, dict(e.values), dict(e.constants))) for e in contents.effects
        )
        for effect in effects:
            _check_effect(effect)
        return cls(base, in_order(effects), dict(contents.constants.swing), dict(contents.constants.units))

    def predict(self, passage: Passage, initial: Mapping[str, float]) -> dict[str, Array] | None:
        """Return name of the signal -> values (n,) at its stamps, or None if the motion diverges.

        initial : name of the state -> initial value (default 0).
        """
        simulator = ExtendedSimulator(self.base.form, self.effects)
        x_0 = np.array([initial.get(n, 0.0) for n in simulator.states])
        found = simulator.run(self.base.theta, self.effects, x_0, passage)
        return None if found is None else {n: y for n, (y, _) in found.items()}


def _as_now(effect: EffectInstance) -> EffectInstance:
    """Convert an effect of an older file to the present table.

    Until 2026-11, ``speed-damping`` was the signed ``u r``.
    """
    if effect.slug == "speed-damping" and "N_ur" in effect.values:
        return EffectInstance("velocity-product", "N_ur", {"coefficient": effect["N_ur"]}, effect.constants)
    return effect


def _check_effect(effect: EffectInstance) -> None:
    """Reject an effect that is not in the table, or whose numbers do not match its parameters."""
    own = [q.name for q in lookup(EFFECTS, effect.slug, "effect").parameters]
    missing = [n for n in own if n not in effect.values and n not in effect.constants]
    strange = [n for n in effect.values if n not in own]
    if missing or strange:
        what = f"lacks {', '.join(missing)}" if missing else f"has no parameter {', '.join(strange)}"
        raise BadFile(f"effect {effect.slug} {what}")
