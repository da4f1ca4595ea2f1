"""Read plans, which define the manoeuvres that identify parameters and their order.

The approach is that of Erunsal2017, section 3 and figure 3.

A plan is a TOML file::

    name = "usv_6dof"
    title = "..."
    [known]                       # constants of the craft, measured ashore or from the lines plan, SI units
    m = 11.0
    [[step]]
    name = "roll decay"
    manoeuvre = "roll_decay"      # runs with this manoeuvre in their side file, or a list; or runs = ["roll_*"]
    dofs = ["sway", "roll", "yaw"]
    isolated = ["K_p", "K_pp"]    # parameters that act in this step only: final after it
    shared = ["I_x", "I_xz"]      # parameters that act in other steps too: combined at the end
    held = ["I_z", "N_r"]         # parameters fixed at the value of an earlier step, [known] or [start]
    local = ["K_0"]               # nuisance parameters of this step, not used by others
    signals = ["phi", "p", "r"]
    validate = 1                  # number of last runs kept out of the fit for local validation
    [step.inputs.N]
    N = 1
    [final]                       # all parameters together, validated on runs that were not fitted
    manoeuvre = "free_motion"
    dofs = [...]
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, Struct

from gcs_autotune.documents import conformed, load_toml
from gcs_autotune.errors import BadFile
from gcs_autotune.models import Form, form_from
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup, same_name
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial
from gcs_autotune_files import parse
from gcs_autotune_files.model import Dof, Name, Numbers, Seconds

__all__ = ["PLANS", "Final", "Plan", "PlanStep", "load_plan", "plan_from"]


class _Motion(Struct, forbid_unknown_fields=True, frozen=True):
    """Fields common to a step and the final model in a plan file."""

    dofs: list[Dof]
    manoeuvre: str | list[Name] = ""
    runs: list[Name] = []
    inputs: dict[Name, dict[Name, float | Name]] = {}
    signals: list[Name] = []
    coriolis: bool = True


class _StepData(_Motion, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """Table ``[[step]]`` of a plan file."""

    name: Name
    title: str = ""
    isolated: list[Name] = []
    shared: list[Name] = []
    held: list[Name] = []
    local: list[Name] = []
    known: Numbers = {}
    start: Numbers = {}
    validate: Annotated[int, Meta(ge=0, le=1000)] = 1
    method: Name = "output-error"
    delay: Seconds = 0.0


class _PlanData(Struct, forbid_unknown_fields=True, frozen=True):
    """Contents of a plan file."""

    name: Name
    step: list[_StepData]
    title: str = ""
    known: Numbers = {}
    start: Numbers = {}
    final: _Motion | None = None


@dataclass(frozen=True, slots=True)
class Chosen:
    """Selection of runs by their manoeuvre (``meta["manoeuvre"]``) or by patterns of their names.

    Manoeuvres have the names used by ``fly``, or any other, with the force if only runs of one force are meant
    (``steps N``). Case, hyphens and underscores are ignored. A run whose ``meta["dof"]`` is not in ``dofs`` is not
    selected.
    """

    manoeuvres: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    dofs: tuple[str, ...] = ()

    def of(self, trials: Sequence[Trial]) -> tuple[Trial, ...]:
        """Return the selected *trials* in their original order."""
        return tuple(t for t in trials if self._means(t))

    def _means(self, trial: Trial) -> bool:
        if self.runs:
            return any(fnmatch.fnmatchcase(trial.name, pattern) for pattern in self.runs)
        manoeuvre, dof = trial.meta.get("manoeuvre"), trial.meta.get("dof")
        if dof in DOFS and dof not in self.dofs:
            return False
        if manoeuvre is None:
            return False
        own = (manoeuvre, f"{manoeuvre} {trial.meta.get('force')}")
        return any(same_name(mine, name) for mine in own for name in self.manoeuvres)

    def __str__(self) -> str:
        of = " or ".join(f"'{name}'" for name in self.manoeuvres)
        return f"named {' or '.join(self.runs)}" if self.runs else f"of manoeuvre {of}"


@dataclass(frozen=True, slots=True)
class PlanStep:
    """One kind of experiment, and the parameters it identifies.

    - ``form``: the form to fit. Its free parameters are ``isolated``, ``shared`` and ``local``, in this order.
    - ``isolated``: parameters that act in this step only.
    - ``shared``: parameters that act in other steps too.
    - ``local``: parameters of this step that other steps do not use.
    - ``held``: parameters that an earlier step identified and this step keeps fixed.
    - ``validate``: number of runs that are used for validation only.
    - ``delay`` [s]: known delay.
    """

    name: str
    chosen: Chosen
    form: Form
    isolated: tuple[str, ...]
    shared: tuple[str, ...]
    held: tuple[str, ...]
    local: tuple[str, ...]
    signals: tuple[str, ...]
    validate: int = 1
    method: str = "output-error"
    delay: float = 0.0

    def global_name(self, name: str) -> str:
        """Return the name of the parameter *name* among all steps.

        A local parameter is prefixed with the name of its step.
        """
        return f"{self.name}: {name}" if name in self.local else name


@dataclass(frozen=True, slots=True)
class Final:
    """The final model with all parameters, and the runs for its validation."""

    chosen: Chosen
    form: Form
    signals: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Plan(Displayed):
    """A plan with its steps in order.

    - ``known``: name -> value of constants of the craft, in SI units.
    - ``start``: name -> a-priori value of a parameter, in SI units.
    """

    name: str
    title: str
    known: Mapping[str, float]
    start: Mapping[str, float]
    steps: tuple[PlanStep, ...]
    final: Final | None = None
    data: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that the plan identifies, without local ones, in the order of first appearance."""
        return tuple(dict.fromkeys(n for s in self.steps for n in (*s.isolated, *s.shared)))

    def knowing(self, values: Mapping[str, float]) -> Plan:
        """Return the plan with *values* for the constants of the craft (``m``, ``K_phi`` ...)."""
        return plan_from({**self.data, "known": {**self.known, **values}}, f"plan '{self.name}'")


def load_plan(path: Path | str) -> Plan:
    """Return the plan with the name *path* if it is shipped with this package, else the plan in the TOML file *path*.

    Raises
    ------
    BadFile
        The file cannot be read, is not TOML, or is not a plan. The message states the step and the reason.
    UnknownName
        There is no shipped plan of this name.
    """
    place = Path(path)
    if place.suffix != ".toml":
        return lookup(PLANS, str(path), "plan")
    return plan_from(load_toml(place, "a plan"), str(place))


def plan_from(data: Mapping[str, Any], origin: str) -> Plan:
    """Return the plan defined by *data*, the contents of the plan file *origin*.

    Exceptions are those of :func:`load_plan`.
    """
    parsed = conformed(data, _PlanData, origin)
    steps = tuple(_step(step, parsed, origin) for step in parsed.step)
    final = None if parsed.final is None else _final(parsed.final, steps, parsed.known, origin)
    plan = Plan(parsed.name, parsed.title or parsed.name, parsed.known, parsed.start, steps, final, data)
    _check_order(plan, origin)
    return plan


def _chosen(parsed: _Motion, where: str) -> Chosen:
    manoeuvres = (parsed.manoeuvre,) if isinstance(parsed.manoeuvre, str) else tuple(parsed.manoeuvre)
    chosen = Chosen(manoeuvres, tuple(parsed.runs), tuple(parsed.dofs))
    if not any(chosen.manoeuvres) and not chosen.runs:
        raise BadFile(f'{where}: select the runs with manoeuvre = "..." or runs = ["name*"]')
    return chosen


def _step(parsed: _StepData, plan: _PlanData, origin: str) -> PlanStep:
    where = f"{origin}, step '{parsed.name}'"
    identified = (*parsed.isolated, *parsed.shared, *parsed.local)
    both = [n for n in parsed.held if n in identified]
    if both or not (parsed.isolated or parsed.shared):
        raise BadFile(
            f"{where}: {', '.join(both)} cannot be both held and identified" if both else f"{where} identifies nothing"
        )
    ashore = [n for n in parsed.held if n in plan.known]
    form = form_from(
        {
            "name": parsed.name,
            "dofs": parsed.dofs,
            "free": [*identified, *(n for n in parsed.held if n not in ashore)],
            "known": {**{n: plan.known[n] for n in ashore}, **parsed.known},
            "inputs": parsed.inputs,
            "coriolis": parsed.coriolis,
            "start": {n: v for n, v in {**plan.start, **parsed.start}.items() if n in identified or n in parsed.held},
        },
        where,
    )
    return PlanStep(
        name=parsed.name,
        chosen=_chosen(parsed, where),
        form=form,
        isolated=tuple(parsed.isolated),
        shared=tuple(parsed.shared),
        held=tuple(n for n in parsed.held if n not in ashore),
        local=tuple(parsed.local),
        signals=tuple(parsed.signals),
        validate=parsed.validate,
        method=parsed.method,
        delay=parsed.delay,
    )


def _final(parsed: _Motion, steps: Sequence[PlanStep], known: Mapping[str, float], origin: str) -> Final:
    where = f"{origin}, final"
    names = dict.fromkeys(n for s in steps for n in (*s.isolated, *s.shared))
    form = form_from(
        {
            "name": "final",
            "dofs": parsed.dofs,
            "free": [n for n in names if n not in known],
            "known": known,
            "inputs": parsed.inputs,
            "coriolis": parsed.coriolis,
        },
        where,
    )
    return Final(_chosen(parsed, where), form, tuple(parsed.signals))


def _check_order(plan: Plan, origin: str) -> None:
    """Raise BadFile for a held parameter that is not yet known, or an isolated one that another step identifies."""
    names = [s.name for s in plan.steps]
    if not names or len(set(names)) < len(names):
        raise BadFile(f"{origin}: a plan needs steps with different names")
    seen = set(plan.start)
    for step in plan.steps:
        blind = [n for n in step.held if n not in seen and n not in step.form.start]
        if blind:
            raise BadFile(
                f"{origin}, step '{step.name}': {', '.join(blind)} is held, but no earlier step identifies it. Add "
                "it to [known] or [start]"
            )
        for other in plan.steps:
            again = [n for n in step.isolated if other is not step and n in (*other.isolated, *other.shared)]
            if again:
                raise BadFile(
                    f"{origin}: {', '.join(again)} is isolated in '{step.name}' but also identified in '{other.name}'"
                )
        seen |= {*step.isolated, *step.shared}


def _shipped() -> dict[str, Plan]:
    folder = resources.files("gcs_autotune.identify.plan") / "plans"
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    plans = [plan_from(parse(f.read_bytes(), "toml"), f.name) for f in files]
    return {p.name: p for p in plans}


PLANS: Mapping[str, Plan] = _shipped()
"""Name -> plan shipped with this package. To add one, add a file to ``plans/``."""
