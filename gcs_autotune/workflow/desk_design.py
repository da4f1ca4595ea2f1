"""``design``: gains for a loop, or the limit cycle of a relay, from a model at the desk. No vehicle is needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_autotune.axes import EXCITATIONS
from gcs_autotune.control import (
    LEAST_MARGINS,
    LINE_LAWS,
    LineQuestion,
    design_own,
    omega_for_settling,
    settling_time,
    uncertainty_of,
)
from gcs_autotune.design import (
    STYLE_STEPS,
    Change,
    Spec,
    analyse_own,
    analyse_proposal,
    design,
    in_fractions,
    over_windows,
    pulse_of,
    style_of,
    turn_rate_step,
)
from gcs_autotune.documents import MODEL, load_json
from gcs_autotune.errors import NoGainsMeetSpec, UsageError
from gcs_autotune.firmware import FIRMWARE, Axis, read_named
from gcs_autotune.identify import ModelFile, fit_axis, load_model, model_file_of
from gcs_autotune.identify.relay import predict_cycle
from gcs_autotune.logs import TRIALS_FOLDER, load_runs
from gcs_autotune.manoeuvres import SHARE_OF_TOP, windows_of
from gcs_autotune.mavlink import load_params
from gcs_autotune.registry import lookup
from gcs_autotune.report import DesignedGains, DesignedOwn, DesignedRelay
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial, load_meta, load_trial
from gcs_autotune.workflow.authority import readable_runs
from gcs_autotune.workflow.designing import criteria_of, spec_as_flown
from gcs_autotune.workflow.nominal_plant import motion_of
from gcs_autotune.workflow.own_loops import SUPPLIED, range_of
from gcs_autotune.workflow.proof import cruise_pair, known_of
from gcs_autotune.workflow.supplied_model import SuppliedModel, supplied_for

__all__ = ["DeskSettings", "design_at_desk", "designs_of_styles"]

RELAY_OUTPUT = 0.3
"""Output of a relay if none is set [fraction of full]: that at which a relay in flight starts."""
RELAY_RATE = 25.0
"""Rate at which a relay is switched [Hz] if none is set: that of `experiment` on a vehicle."""
THROTTLE = 0.5
"""Throttle of a speed loop [fraction] if none is set: CRUISE_THROTTLE's default."""

GAINS = "gains.json"
"""Name of the file with the proposal of a tune, in its run directory."""

SETTLINGS = 3.0
"""Duration of a step of our own loop in settling times."""


@dataclass(frozen=True, slots=True)
class DeskSettings:
    """One run of ``design``; SI units and radians. None means that the design chooses.

    Attributes
    ----------
    source : a model file, the JSON output of an identification, or a run directory.
    loop : a name in :data:`TASKS`. own : for a controller of our own instead of the autopilot's.
    firmware : name in ``FIRMWARE``; empty: that of the vehicle's parameters or runs, or the first one with the loop.
    parameters : file with the vehicle's present gains; None: those of the run directory, or the firmware's defaults.
    full_scale : model input at full output, if the model's input is not an output.
    speed, throttle : speed [m/s] and throttle [fraction] at which a boat was identified.
    step : size of the step [rad, m or m/s]. kind : family of the model function.
    style : margins and bandwidth, one of ``design.style_of``.
    omega_0 [rad/s], settling_time [s] : speed of the loop. gain_margin [ratio], phase_margin [rad] : least margins,
    instead of those of the style.
    guidance, approach : line law, a name in ``LINE_LAWS``, and its largest angle to the line [rad].
    dof : degree of freedom of a relay; empty: yaw, or the only one of the model.
    relay_output, relay_hysteresis : of a relay [fraction of full], [rad or m]. control_rate : its switching rate [Hz].
    """

    source: Path
    loop: str
    own: bool = False
    firmware: str = ""
    parameters: Path | None = None
    full_scale: float | None = None
    speed: float | None = None
    throttle: float | None = None
    step: float | None = None
    kind: str = "bessel"
    style: str = "normal"
    omega_0: float | None = None
    settling_time: float | None = None
    gain_margin: float | None = None
    phase_margin: float | None = None
    guidance: str = "direct"
    approach: float = math.radians(45.0)
    dof: str = ""
    relay_output: float | None = None
    relay_hysteresis: float | None = None
    control_rate: float | None = None


Designed = DesignedGains | DesignedOwn | DesignedRelay


def design_at_desk(settings: DeskSettings) -> Designed:
    """Return the gains, or the limit cycle of a relay, with their analysis.

    Raises
    ------
    UsageError, UnknownName
        The loop does not exist, or a number that it needs is missing.
    BadFile, NotInformative
        The source has no model; or a relay causes no limit cycle.
    NoGainsMeetSpec
        No gains keep the specification; the message states the nearest that is feasible.
    """
    return lookup(TASKS, settings.loop, "loop")(settings)


def designs_of_styles(settings: DeskSettings) -> dict[str, DesignedGains | str]:
    """Return the design of a loop of the autopilot for each of ``STYLE_STEPS``, or why no gains keep its margins.

    Raises
    ------
    UsageError, BadFile, NotInformative
        As :func:`design_at_desk`.
    """
    found: dict[str, DesignedGains | str] = {}
    firmware, axis = _axis(settings, settings.loop)  # the runs are read once, not for every style
    settings = replace(settings, firmware=firmware, speed=_speed(settings, axis))
    for style in STYLE_STEPS:
        try:
            designed = design_at_desk(replace(settings, style=style))
        except NoGainsMeetSpec as error:
            found[style] = str(error)
        else:
            assert isinstance(designed, DesignedGains)
            found[style] = designed
    return found


# --- what it is designed from -------------------------------------------------------------------------------------


def _model(settings: DeskSettings, dof: str) -> ModelFile:
    """Return the model of the source. A run directory without a model file is identified."""
    path = settings.source
    if not path.is_dir():
        return load_model(path)
    for name in (f"model-{dof}.json", MODEL):
        if (path / name).is_file():
            return replace(load_model(path / name), name=path.name)
    return replace(model_file_of(fit_axis(load_runs(path), dof=dof)), name=path.name)


def _stated(settings: DeskSettings) -> Sequence[Mapping[str, Any]]:
    """Return the metadata of the runs in the directory; none for a model file."""
    if not settings.source.is_dir():
        return ()
    tables = sorted((settings.source / TRIALS_FOLDER).glob("*.csv"))
    # the samples of a run directory take up to a second to read, and only the metadata is needed
    return [load_meta(file) for file in tables] or [run.meta for run in readable_runs(settings.source)]


def _speed(settings: DeskSettings, axis: Axis) -> float | None:
    """Return the speed of the settings, or else that of the runs in the directory if *axis* needs one [m/s]."""
    if settings.speed is not None or not axis.needs_speed:
        return settings.speed
    stated = (float(meta.get("speed") or math.nan) for meta in _stated(settings))
    known = [speed for speed in stated if math.isfinite(speed) and speed > 0.0]
    return float(np.median(known)) if known else None


class _Parameters:
    """The parameters of a file, asked like a vehicle."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self._values = values

    def read_any(self, groups: Iterable[Sequence[str]]) -> dict[str, float]:
        """Return, for each group of names, the first one that the file contains."""
        found = (next((name for name in group if name in self._values), "") for group in groups)
        return {name: self._values[name] for name in found if name}


def _parameter_file(settings: DeskSettings) -> Path | None:
    """Return the file with the vehicle's parameters, or None if there is none."""
    if settings.parameters is not None or not settings.source.is_dir():
        return settings.parameters
    files = (settings.source / f"parameters_{name}.param" for name in ("after", "before"))
    return next((file for file in files if file.is_file()), None)


def _present(settings: DeskSettings, axis: Axis) -> tuple[Axis, dict[str, float], str]:
    """Return the axis with the vehicle's names, its parameters under canonical names, and where they come from."""
    path = _parameter_file(settings)
    defaults = {gain.parameter: gain.default for gain in axis.gains}
    if path is None:
        return axis, defaults, "the firmware's defaults"
    names, found = read_named(_Parameters(load_params(path)), [*defaults, *axis.context])
    missing = [name for name in defaults if name not in found]
    rest = f", defaults for {', '.join(missing)}" if missing else ""
    return axis.called(names), {**defaults, **found}, f"{path.name}{rest}"


def _axis(settings: DeskSettings, loop: str) -> tuple[str, Axis]:
    """Return the firmware's name and its loop: the firmware of the settings, or else the one whose gains the vehicle
    has, the one that its runs state, or the first one with this loop.
    """
    if settings.firmware:
        firmware = lookup(FIRMWARE, settings.firmware, "firmware")
        return settings.firmware, lookup(firmware.axes, loop, f"loop of {settings.firmware}")
    possible = {name: f.axes[loop] for name, f in FIRMWARE.items() if loop in f.axes}
    path = _parameter_file(settings)
    if path is not None:
        stored = _Parameters(load_params(path))
        for name, axis in possible.items():
            if read_named(stored, [gain.parameter for gain in axis.gains])[1]:
                return name, axis
    stated = (str(meta.get("firmware", "")).lower() for meta in _stated(settings))
    name = next((name for name in stated if name in possible), next(iter(possible)))
    return name, possible[name]


def _supplied(settings: DeskSettings, axis: Axis) -> tuple[SuppliedModel, tuple[str, ...]]:
    """Return the model with its covariance, and a note if that is assumed."""
    given = supplied_for(_model(settings, axis.dof), axis, settings.full_scale)
    reduction = given.reduction
    if np.any(reduction.covariance):
        return given, ()
    model = reduction.model
    std = np.zeros(5)
    std[0] = SUPPLIED.p_alpha * model.alpha
    std[1:3] = SUPPLIED.p_beta * np.array([model.beta, model.beta_quadratic])
    assumed = replace(reduction, covariance=np.diag((std / HALF_WIDTH) ** 2))
    note = (
        f"The model has no covariance. A 95 % uncertainty of {100.0 * SUPPLIED.p_alpha:.0f} % in inertia and "
        f"{100.0 * SUPPLIED.p_beta:.0f} % in drag is assumed"
    )
    return replace(given, reduction=assumed), (note,)


# --- the autopilot's loops ----------------------------------------------------------------------------------------


def _gains(settings: DeskSettings) -> Designed:
    """Design the gains of the autopilot's own loop."""
    if settings.own:
        return _own(settings)
    firmware, plain = _axis(settings, settings.loop)
    axis, present, origin = _present(settings, plain)
    (given, notes), speed = _supplied(settings, axis), _speed(settings, axis)
    if axis.needs_speed and axis.steers_by_way and speed is None:
        raise UsageError(f"no speed given. Use --speed with the speed at which '{given.file.name}' was identified")
    flown = _flown_step(settings, axis)
    if flown is not None and settings.step is None:
        settings = replace(settings, step=abs(float(flown.meta["size"])))
    spec, windows = _spec(settings, axis, given, speed, present), tuple[float, ...]()
    if flown is not None and settings.step == abs(float(flown.meta["size"])):
        spec = spec_as_flown(spec, criteria_of(flown, moving=axis.kind.controls_velocity), flown)
        windows = _compared_windows(settings) or windows_of(flown)
        spec = replace(spec, windows=windows)
        notes = (*notes, _over(windows, given.file.name))
    elif flown is not None:
        notes = (*notes, f"The step of the run {given.file.name} had another size. Its figures are not comparable")
    reduction = given.reduction
    question = (reduction.model, reduction.covariance, axis, present, spec, reduction)
    proposal = over_windows(design(*question), windows)
    before, after = analyse_proposal(proposal, *question)
    changed = {change.parameter: change for change in proposal.changes}
    rows = []
    for gain in axis.gains:
        name = axis.names.own(gain.parameter)
        old, low, high = (
            axis.names.own_value(gain.parameter, v) for v in (present[gain.parameter], gain.low, gain.high)
        )
        rows.append(changed.get(name, Change(name, old, old, low, high, f"{gain.meaning}: unchanged")))
    return DesignedGains(firmware, given.file.name, speed, tuple(rows), origin, proposal, before, after, notes)


def _flown_step(settings: DeskSettings, axis: Axis) -> Trial | None:
    """Return the first step of the run directory that proved gains of *axis*, or None."""
    kind = DOFS[axis.dof]
    signal = kind.velocity if axis.kind.controls_velocity else kind.position
    for file in sorted((settings.source / TRIALS_FOLDER).glob("*.csv")):
        meta = load_meta(file)
        if meta.get("purpose") == "proof" and meta.get("signal") == signal and "size" in meta and "duration" in meta:
            return load_trial(file)
    return None


def _compared_windows(settings: DeskSettings) -> tuple[float, ...]:
    """Return the times [s] over which the tune in the run directory compared its steps; empty if it compared none."""
    file = settings.source / GAINS
    found = load_json(file, "the gains of a run") if file.is_file() else {}
    if not isinstance(found, dict) or found.get("axis") != settings.loop:
        return ()
    return tuple(float(seconds) for seconds in found.get("windows", ()))


def _over(windows: Sequence[float], run: str) -> str:
    """Return a sentence on the times [s] of the steps in *run*, over which the predictions are evaluated."""
    whats = zip(windows, ("the step", "the step back"), strict=False)
    times = " and ".join(f"{seconds:.3g} s after {what}" for seconds, what in whats)
    return f"The predictions are over the times of run {run}: {times}"


def _spec(
    settings: DeskSettings, axis: Axis, given: SuppliedModel, speed: float | None, present: Mapping[str, float]
) -> Spec:
    """Return the specification; the steps of velocity loops are those that ``tune`` flies."""
    known, step, measured = known_of(given, axis), settings.step, dict[str, float]()
    if axis.excitation.by_throttle:
        throttle = THROTTLE if settings.throttle is None else settings.throttle
        kept = known.model.steady_velocity(float(known.actuator.static(np.array([pulse_of(throttle, present)]))[0]))
        top = kept if speed is None else speed
        step = SHARE_OF_TOP * top if step is None else step
        if not top > step:
            raise UsageError(f"a step of {step:.2g} m/s is not below the speed of {top:.2g} m/s. Use a smaller --step")
        speed, measured = top - step, cruise_pair(known, throttle, present)
    elif axis.kind.controls_velocity and step is None:
        step = turn_rate_step(known.model, at_rest=not speed)[0]
    style = style_of(settings.style)
    return Spec(
        step=axis.kind.step if step is None else step,
        kind=settings.kind,
        omega_0=settings.omega_0,
        settling_time=settings.settling_time,
        speed=speed if axis.needs_speed else None,
        full_scale=given.full_scale,
        bandwidth=style.bandwidth,
        gain_margin=style.gain_margin if settings.gain_margin is None else settings.gain_margin,
        phase_margin=style.phase_margin if settings.phase_margin is None else settings.phase_margin,
        quantum=given.reduction.quantum,
        measured=measured,
    )


# --- controllers of our own ---------------------------------------------------------------------------------------


def _own(settings: DeskSettings) -> DesignedOwn:
    """Design a controller of our own, as ``hold`` flies it; for a line its heading loop and the law above it."""
    is_line = settings.loop == "line"
    _, axis = _axis(settings, "heading" if is_line else settings.loop)
    if axis.kind.controls_velocity:
        raise UsageError(f"there is no controller of our own for {axis.name}. Use heading, depth or line")
    (given, notes), speed = _supplied(settings, axis), _speed(settings, axis)
    if is_line and speed is None:
        raise UsageError("no speed given. Use --speed with the craft's speed on the line")
    known, full = known_of(given, axis), given.full_scale or 1.0
    _, covariance = in_fractions(given.reduction.model, given.reduction.covariance, full)
    step = axis.kind.step if settings.step is None else settings.step
    omega_0 = settings.omega_0
    if settings.settling_time is not None:
        omega_0 = omega_for_settling(settings.kind, settings.settling_time)
    style = style_of(settings.style)
    least = LEAST_MARGINS
    if style.bandwidth < 1.0:  # the model function sets the phase margin
        least = replace(least, gain=style.gain_margin)
    if settings.gain_margin is not None:
        least = replace(least, gain=settings.gain_margin)
    if settings.phase_margin is not None:
        least = replace(least, phase=settings.phase_margin)
    found = design_own(
        known.model,
        uncertainty_of(known.model, covariance),
        step=step,
        limits=range_of(known.actuator),
        kind=settings.kind,
        omega_0=omega_0,
        least=least,
        bandwidth=style.bandwidth,
    )
    span = SETTLINGS * settling_time(found.wanted.kind, found.wanted.omega_0)
    law = None
    if is_line:
        assert speed is not None
        loop, wanted = found.law.closed_loop(found.model), found.wanted
        question = LineQuestion(found.model, loop, wanted.kind, wanted.omega_0, speed, settings.approach)
        law = lookup(LINE_LAWS, settings.guidance, "line law")(question)
    guidance = settings.guidance if is_line else ""
    analysis = analyse_own(found, covariance, step, span)
    return DesignedOwn(axis.name, given.file.name, found, analysis, guidance, law, notes)


# --- a relay ------------------------------------------------------------------------------------------------------


def _relay(settings: DeskSettings) -> DesignedRelay:
    """Predict the limit cycle of a relay by its describing function."""
    file = _model(settings, settings.dof or "yaw")
    dofs = file.model.base.form.dofs
    dof = settings.dof or ("yaw" if "yaw" in dofs else dofs[0])
    excitation = lookup(EXCITATIONS, dof, "degree of freedom with a relay")
    model = motion_of(file, dof, settings.full_scale)
    C = RELAY_OUTPUT if settings.relay_output is None else settings.relay_output
    x_a = excitation.least_hysteresis if settings.relay_hysteresis is None else settings.relay_hysteresis
    rate = RELAY_RATE if settings.control_rate is None else settings.control_rate
    return DesignedRelay(file.name, model, rate, predict_cycle(model, C, x_a, sample_time=1.0 / rate))


TASKS: Mapping[str, Callable[[DeskSettings], Designed]] = {
    "heading": _gains,
    "yaw": _gains,
    "speed": _gains,
    "depth": _gains,
    "line": _own,
    "relay": _relay,
}
"""What is designed -> its function; one line adds another."""
