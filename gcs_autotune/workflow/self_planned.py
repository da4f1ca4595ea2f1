"""A trial that plans itself (Goodwin1977, chapter 6).

After each run the model is identified. The manoeuvre with the most information per minute is flown next, until the
required precision is reached.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from gcs_autotune.errors import AutotuneError, NotInformative, UsageError
from gcs_autotune.experiments import rank_by_precision, relative_errors, shortfall
from gcs_autotune.firmware import Firmware
from gcs_autotune.identify import Fit, Model, fit, validate
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    Envelope,
    Manoeuvre,
    ManoeuvreKind,
    OpenLoopProgramme,
    Preset,
    limited_orders,
)
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.flight_plan import FlightRun, FlySettings
from gcs_autotune.workflow.precision import Precision
from gcs_autotune.workflow.settings import CommonSettings

__all__ = [
    "Choice",
    "Offer",
    "Outlook",
    "SelfPlanner",
    "TrialStep",
    "check_identifiable",
    "driven",
    "first_run",
    "look_ahead",
    "offers_for",
]

GRID: Mapping[str, tuple[float, ...]] = {
    "steering": (0.3, 0.6, 1.0),
    "heading": (math.radians(10.0), math.radians(20.0)),
    "duration": (20.0, 40.0, 80.0),
}
"""Option of a manoeuvre -> sizes considered for a run (SI). Other options have their defaults."""
THROTTLES = (0.0, 0.5)
"""Forward thrust [fraction] considered for a craft that steers at rest. Project choice."""
SHORT = 20.0
"""Duration [s] of a first vertical or sideways run of an unknown craft.

It stays within a metre or two. Project choice.
"""
SHORT_S = 30.0
"""Duration [s] of a first S.

It is half as long as an S flown alone, because the runs chosen after it are more informative. Project choice.
"""
LONGEST = 240.0
"""Longest manoeuvre [s] considered. Two shorter ones allow a choice in between. Project choice."""
OVERHEAD = 5.0
"""Additional time [s] assumed for each run, without a boat's return. Project choice."""
LEAST_IMPROVEMENT = 0.05
"""Smallest reduction of the sum of the logarithmic errors that counts as an improvement. Project choice."""
MAX_UNSUCCESSFUL = 2
"""Number of runs without improvement after which the trial ends. Project choice."""


# --- what may be flown --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Offer:
    """A candidate for the next run: a manoeuvre of one size."""

    settings: FlySettings
    throttle: float
    keep_still: bool

    @property
    def title(self) -> str:
        """Name and size of the manoeuvre as text."""
        sizes = []
        for name, value in self.settings.options.items():
            if name == "steering":
                sizes.append(f"{100.0 * value:.0f} %")
            elif name == "heading":
                sizes.append(f"{math.degrees(value):.0f} deg")
            elif name == "duration":
                sizes.append(f"{value:.0f} s")
        if self.throttle:
            sizes.append(f"throttle {100.0 * self.throttle:.0f} %")
        force = f" of {self.settings.force}" if self.settings.force else ""
        return f"{self.settings.kind.name}{force}" + (f" ({', '.join(sizes)})" if sizes else "")

    def make(self) -> Manoeuvre:
        """Return the manoeuvre."""
        return self.settings.make(self.throttle, keep_still=self.keep_still)

    def as_preset(self, dofs: Sequence[str]) -> Preset:
        """Return the offer as a candidate manoeuvre for the experiment design of a model of *dofs*."""
        forces = sorted(self.settings.kind.drives | ({"X"} if self.throttle else set()))
        made, told = self.make(), {DOFS[dof].position for dof in dofs}
        by_the_clock = isinstance(made, OpenLoopProgramme) and not made.held & told
        return Preset(self.title, " ".join(forces), lambda seconds: self.make(), closed=not by_the_clock)


def first_run(precision: Precision, common: CommonSettings) -> FlySettings:
    """Return the default first run: an S for several degrees of freedom, doublets or steps for one."""
    if len(precision.dofs) > 1:
        return FlySettings("s-manoeuvre", common, {"duration": SHORT_S})
    force = DOFS[precision.dofs[0]].force
    short = {} if force in "XN" else {"duration": SHORT}
    return FlySettings("steps" if force == "X" else "doublets", common, short, force=force)


def offers_for(
    precision: Precision,
    first: FlySettings,
    firmware: Firmware,
    craft_forces: Collection[str],
    cruise: float,
    options: Mapping[str, float] | None = None,
) -> list[Offer]:
    """Return every manoeuvre of the table that excites the form, in the sizes of :data:`GRID`.

    Only *craft_forces* are driven: those that the craft can produce. *cruise* is a boat's throttle. *options* (SI)
    apply to all manoeuvres that have them, in place of the sizes in the table.
    """
    typed = options or {}
    able = {DOFS[dof].force for dof in precision.dofs} & set(craft_forces)
    keep_still = not firmware.needs_way
    throttles = (cruise,) if firmware.needs_way else THROTTLES if "X" in able else (0.0,)
    found: dict[str, Offer] = {}
    for kind in _kinds(able):
        if not (kind.identifies and kind.is_alone and kind.suits(firmware) and kind.drives <= able):
            continue
        if kind.tied or kind.needs:  # a bollard or a wall ahead must be requested
            continue
        for sizes, throttle in itertools.product(_sizes(kind, typed), throttles):
            common = replace(first.common, throttle=throttle)
            force = next(iter(kind.drives)) if kind.for_force is not None else ""
            given = {n: v for n, v in typed.items() if n in kind.options}
            try:
                settings = FlySettings(kind.name, common, {**sizes, **given}, 1, None, None, force)
            except AutotuneError:
                continue  # a size that this manoeuvre cannot have
            offer = Offer(settings, throttle, keep_still)
            found[offer.title] = offer
    return list(found.values())


def _kinds(forces: set[str]) -> Iterator[ManoeuvreKind]:
    for kind in MANOEUVRES.values():
        if kind.for_force is None or not kind.identifies:
            yield kind
        else:
            yield from (kind.of(force) for force in sorted(forces))


def _sizes(kind: ManoeuvreKind, typed: Mapping[str, float]) -> list[dict[str, float]]:
    names = [name for name in GRID if name in kind.options and name not in typed]
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*(GRID[n] for n in names))]


# --- what is known, and what comes next ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Choice:
    """A candidate for the next run, with its predicted result.

    ``offer``: its number in the list of offers.
    ``relative``: relative standard errors expected after it.
    ``seconds``: its duration.
    ``room`` [m], ``depth`` [m], ``turned`` [rad]: distance, depth and turn of the simulated run.
    ``gain``: reduction of the errors that are still too large, as the sum of their natural logarithms.
    """

    offer: int
    relative: Mapping[str, float]
    seconds: float
    room: float
    depth: float
    turned: float
    gain: float


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """The present model and the candidates for the next run, best first.

    Attributes
    ----------
    relative : standard errors of the required parameters, divided by their values.
    predicted : how well [%] the model identified before the last run predicted that run; NaN if there was none.
    choices : candidates for the next run; None if the model is unstable, so that nothing can be predicted.
    """

    fit: Fit[Model]
    relative: Mapping[str, float]
    predicted: float
    choices: tuple[Choice, ...] | None = ()


def look_ahead(
    runs: Sequence[Trial], before: Fit[Model] | None, precision: Precision, offers: Sequence[Offer], overhead: float
) -> Outlook:
    """Identify the form from all *runs* and rank the *offers*. This function runs in a separate process.

    Raises
    ------
    NotInformative
        The runs do not determine this form.
    """
    found = fit(list(runs), dof=precision.form)
    relative = relative_errors(found, precision.wanted)
    predicted = math.nan
    if before is not None:
        try:
            predicted = validate(before.model, runs[-1]).fit_percent
        except NotInformative:
            predicted = -math.inf
    if precision.reached(relative):
        return Outlook(found, relative, predicted)
    most: dict[str, float] = {}
    for run in runs:
        for force, (_, came) in limited_orders(run).items():
            most[force] = max(most.get(force, 0.0), came)
    presets = [offer.as_preset(precision.dofs) for offer in offers]
    number = {id(preset): i for i, preset in enumerate(presets)}
    try:
        ranked = rank_by_precision(
            found, list(runs), precision.wanted, presets, longest=LONGEST, overhead=overhead, most=most
        )
    except NotInformative:
        return Outlook(found, relative, predicted, None)
    choices = tuple(
        Choice(
            number[id(w.candidate)], w.relative, w.seconds, w.flight.reach.room, w.flight.reach.deep,
            w.flight.reach.turned, w.rate * w.seconds / 60.0,
        )
        for w in ranked
    )  # fmt: skip
    return Outlook(found, relative, predicted, choices)


def driven(precision: Precision, craft_forces: Collection[str]) -> tuple[str, ...]:
    """Return those degrees of freedom of the form that one of *craft_forces* drives."""
    return tuple(dof for dof in precision.dofs if DOFS[dof].force in craft_forces)


def check_identifiable(precision: Precision, first: ManoeuvreKind, craft_forces: Collection[str]) -> None:
    """Check, before anything moves, that the vehicle and its *first* run can excite the required parameters.

    *craft_forces*: forces that the vehicle can produce.

    Raises
    ------
    UsageError
        The vehicle cannot excite them, or only another manoeuvre does.
    """
    asked, able = precision.title, driven(precision, craft_forces)
    if not able:
        raise UsageError(
            f"{asked}: no actuator drives {' or '.join(precision.dofs)} on this vehicle (it has "
            f"{', '.join(craft_forces)}), so no run can identify this parameter. Nothing was flown"
        )
    forces = {DOFS[dof].force for dof in able}
    if not forces & first.drives:
        raise UsageError(
            f"{asked}: {first.name} drives {' and '.join(sorted(first.drives))} and does not excite this parameter. "
            f"Omit the manoeuvre, or use one that drives {' or '.join(sorted(forces))}. Nothing was flown"
        )


@dataclass(frozen=True, slots=True, eq=False)
class TrialStep:
    """One run of a self-planned trial: why it was chosen, the precision after it, and why it was the last one."""

    run: str
    why: str
    seconds: float
    precision: Precision
    outlook: Outlook
    ended: str = ""


Think = Callable[..., Outlook]
"""Function that calls its first argument with the other arguments, in a worker while the link is served, and returns
the result.
"""


class SelfPlanner:
    """Decides after each run what is flown next; ``steps`` records the decisions.

    *overhead*: additional seconds of each run (a boat's return). *options* apply to every run that has them. *known*:
    number of earlier runs; if there are any, the first run is also chosen from the data.
    """

    def __init__(
        self,
        until: Precision,
        first: FlightRun,
        firmware: Firmware,
        craft_forces: Collection[str],
        overhead: float,
        say: Callable[[str], None],
        *,
        options: Mapping[str, float] | None = None,
        known: int = 0,
    ) -> None:
        self._until, self._say = until, say
        self._overhead = OVERHEAD + overhead
        self._known = known
        self._offers = offers_for(until, first.settings, firmware, craft_forces, first.throttle, options)
        self._before: Fit[Model] | None = None
        self._left = until.seconds - (0.0 if known else first.preview.seconds)
        self._why = "flown before" if known else "the first"
        self._name = f"{known} earlier run{'s' * (known > 1)}" if known else first.name
        self._tried = [] if known else [first.settings.kind.name]
        self.steps: list[TrialStep] = []

    def next_run(
        self, runs: Sequence[Trial], think: Think, run_of: Callable[[FlySettings], FlightRun]
    ) -> FlightRun | None:
        """Return the settings of the run to fly after *runs*. None if the precision is reached, or if no permitted run
        improves it.

        Raises
        ------
        NotInformative
            The runs do not determine the required parameters.
        """
        until = self._until
        seen = think(look_ahead, runs, self._before, until, self._offers, self._overhead)
        self._before = seen.fit
        self._say(f"after run {len(runs)}: {until.told(seen.relative)}")
        run, why = self._best(seen, len(runs) + 1, run_of)
        self._say(f"next: {why}" if run is not None else why)
        seconds = 0.0 if len(runs) == self._known else runs[-1].duration
        self.steps.append(TrialStep(self._name, self._why, seconds, until, seen, "" if run is not None else why))
        if run is not None:
            self._why, self._name = why, run.name
            self._left -= run.preview.seconds + self._overhead
        return run

    def _best(
        self, seen: Outlook, number: int, run_of: Callable[[FlySettings], FlightRun]
    ) -> tuple[FlightRun | None, str]:
        """Return the best run inside the limits and the time left, with the reason; or the reason why there is none."""
        until = self._until
        if until.reached(seen.relative):
            return None, "the required precision is reached"
        away = [shortfall(s.outlook.relative, until.wanted) for s in self.steps] + [
            shortfall(seen.relative, until.wanted)
        ]
        best = min(away[:-MAX_UNSUCCESSFUL], default=math.inf)
        if min(away[-MAX_UNSUCCESSFUL:]) > best - _noticed(best):
            return None, (
                f"not reached: the last {MAX_UNSUCCESSFUL} runs brought no improvement. The model may lack an "
                "effect that the runs contain. See the doubts, or run gcs-autotune diagnose"
            )
        if seen.choices is None:
            return self._blindly(number, run_of)
        worth = [c for c in seen.choices if c.gain >= _noticed(away[-1])]
        if not worth:
            hopeless = [n for n in until.wanted if not any(c.relative[n] < math.inf for c in seen.choices)]
            what = f" about {' and '.join(hopeless)}" if hopeless else ""
            return None, f"not reached: no available manoeuvre adds information{what}"
        troubles = []
        for choice in worth:
            offer = self._offers[choice.offer]
            if choice.seconds > self._left:
                troubles.append(f"{offer.title} takes longer than the rest of --total-time")
                continue
            run = run_of(replace(offer.settings, name=f"{number}-{offer.settings.kind.name}"))
            guessed = run.preview.craft.assumed and offer.settings.kind.drives == {"Z"}  # the model knows by now
            trouble = _beyond(choice, run.envelope) or ("" if guessed else run.preview.trouble) or run.why_not
            if not trouble:
                expected = until.told(choice.relative)
                return run, f"{offer.title}: expected precision after {choice.seconds:.0f} s: {expected}"
            troubles.append(f"{offer.title}: {trouble}")
        return None, f"not reached: no useful manoeuvre can be flown: {troubles[0]}"

    def _blindly(self, number: int, run_of: Callable[[FlySettings], FlightRun]) -> tuple[FlightRun | None, str]:
        """Return the gentlest run of a manoeuvre that was not flown yet.

        It is used if the model is unstable and therefore cannot predict.
        """
        for offer in self._offers:
            name = offer.settings.kind.name
            if name in self._tried:
                continue
            self._tried.append(name)
            run = run_of(replace(offer.settings, name=f"{number}-{name}"))
            if run.preview.seconds <= self._left and not run.preview.trouble and not run.why_not:
                return run, (
                    f"{offer.title}, a manoeuvre not flown yet, because the model of the runs so far is unstable"
                )
        return None, "not reached: the model of the runs is unstable and no other manoeuvre can be flown"


def _noticed(away: float) -> float:
    """Return the smallest improvement that counts at this distance *away* from the required precision."""
    return min(LEAST_IMPROVEMENT, 0.5 * away)


def _beyond(choice: Choice, envelope: Envelope) -> str:
    """Return a sentence on the safety limit that the predicted flight would reach; empty if none."""
    if choice.room > envelope.distance_limit:
        return f"it needs {choice.room:.0f} m"
    if choice.depth > envelope.depth_excursion:
        return f"it needs {choice.depth:.1f} m of depth"
    if choice.turned > envelope.heading_excursion:
        return f"it turns by {math.degrees(choice.turned):.0f} deg"
    return ""
