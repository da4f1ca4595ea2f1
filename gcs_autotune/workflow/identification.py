"""Identifying aboard: self-oscillations, or two runs of throttle steps, and the model that explains both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.identify import AxisFit, Fit, fit_axis
from gcs_autotune.identify.coupled.one_axis import with_actuator
from gcs_autotune.identify.surge import fit_surge
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import relay_for, second_output, throttle_steps_for
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.third_level import fly_third, third_level
from gcs_autotune.workflow.thrust_curve import fit_thrust_curve, told
from gcs_autotune.workflow.voyage import Voyage

__all__ = ["Identified", "again_with_step", "delay_of", "identify"]


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """The model of one axis, the ``runs`` it was fitted to, and ``curved``: the same model with the bent or dead
    actuator that the record calls for, or None.
    """

    fit: AxisFit
    runs: Sequence[Trial]
    curved: Fit | None = None


def identify(voyage: Voyage, step: Trial | None = None) -> Identified:
    """Fly the experiments of the axis and fit it; errors as those of flying and of ``fit_axis`` or ``fit_surge``.

    step : flown before under the autopilot's own loop, if one was; it tells a dead band from a curve.
    """
    return _by_throttle_steps(voyage) if voyage.axis.dof == "surge" else _by_relays(voyage, step)


def delay_of(settings: TuneSettings) -> float | Literal["auto"]:
    """Return the delay [s] to identify with: the one asked for, else it is estimated."""
    return "auto" if settings.delay is None else settings.delay


def _by_relays(voyage: Voyage, step: Trial | None) -> Identified:
    s, tale, craft, dof = voyage.settings, voyage.tale, voyage.craft, voyage.axis.dof
    still, throttle, least = not craft.firmware.needs_way, voyage.throttle, craft.least_period
    relay = relay_for(s, dof, throttle, s.relay_output, "relay-1", keep_still=still, least_period=least)
    voyage.come_about("relay-1")
    first = voyage.fly(relay, "first self-oscillation").trial
    relay = relay_for(s, dof, throttle, second_output(first), "relay-2", keep_still=still, least_period=least)
    voyage.come_about("relay-2")
    trials = [first, voyage.fly(relay, "second self-oscillation").trial]
    tale.say("identifying")
    plain = _plain(voyage, trials)
    if step is None and s.structure is None and s.most_relays > len(trials):
        third = voyage.think(third_level, trials, plain)
        if third is not None:
            voyage.come_about("relay-3")
            trials += fly_third(third, s, dof, craft, throttle, voyage.helm, tale)
            plain = _plain(voyage, trials)
    tale.fit = plain
    return _with_curve(voyage, plain, trials, step)


def again_with_step(voyage: Voyage, found: Identified, step: Trial) -> Identified:
    """Return *found* with the curve that *step* tells too, flown about the speed that *found* foretold.

    The oscillations are of one size each, larger than what such a step takes; what small outputs do, it alone shows.
    Not of a boat: there the autopilot drives its own throttle meanwhile, on which the steering rests.
    """
    if voyage.axis.dof == "surge" or voyage.axis.needs_speed:
        return found
    voyage.tale.say("identifying, with the step")
    return _with_curve(voyage, found.fit, found.runs, step, with_band=True)


def _with_curve(
    voyage: Voyage, plain: AxisFit, trials: Sequence[Trial], step: Trial | None, *, with_band: bool = False
) -> Identified:
    curved = None
    if voyage.settings.structure is None:
        curved = voyage.think(fit_thrust_curve, trials, plain, step, with_band=with_band)
    if curved is not None:
        voyage.tale.say(told(curved, plain, step))
        voyage.tale.fit = with_actuator(curved, plain)
    return Identified(plain, trials, curved)


def _plain(voyage: Voyage, trials: list[Trial]) -> AxisFit:
    s, dof = voyage.settings, voyage.axis.dof
    return voyage.think(fit_axis, trials, dof=dof, structure=s.structure, delay=delay_of(s))


def _by_throttle_steps(voyage: Voyage) -> Identified:
    s, trials = voyage.settings, list[Trial]()
    for n, stage in enumerate(("first throttle steps", "second throttle steps")):
        name = f"throttle-{n + 1}"
        voyage.come_about(name)
        trials.append(voyage.fly(throttle_steps_for(voyage.throttle, n, name), stage).trial)
    voyage.tale.say("identifying")
    fit = voyage.think(fit_surge, trials, structure=s.structure, delay=delay_of(s))
    voyage.tale.fit = fit
    return Identified(fit, trials)
