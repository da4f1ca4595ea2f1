"""A form: the structure of a coupled model without numbers, with its degrees of freedom, derivatives and inputs.

Forms come from the table :data:`FORMS` (one TOML file each in ``forms/``) or from a user's file::

    name = "horizontal"
    title = "surge, sway and yaw, coupled"
    dofs = ["surge", "sway", "yaw"]
    free = ["X_udot", "Y_vdot", "N_rdot", "X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr"]
    coriolis = true            # C(nu) from M; false: only the listed product terms

    [known]                    # constants, in SI units
    m = 8.0

    [inputs.X]                 # channel X drives the surge equation with gain 1 ...
    X = 1
    [inputs.delta]             # ... and the rudder two equations with gains to be fitted
    Y = "Y_delta"
    N = "N_delta"
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

from gcs_autotune.documents import conformed, load_toml
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.models.coupled.derivatives import FORCES, RIGID_BODY, SPECIAL, inertia_of, term_of, unit_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import DOFS
from gcs_autotune_files import parse
from gcs_autotune_files.model import FormData

__all__ = ["FORMS", "Form", "form_from", "form_of", "load_form"]

_ORDER = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True)
class Form(Displayed):
    """The structure of a coupled model.

    - ``dofs``: degrees of freedom in SNAME order.
    - ``free``: names of the parameters to identify (see :mod:`.derivatives`).
    - ``known``: name -> value of the other parameters.
    - ``inputs``: channel -> ``(force letter, gain)`` pairs. A gain is a number or a parameter's name, preceded by ``-``
      for the opposite sign.
    - ``start``: name -> start value for a search (optional).
    - ``optional``: inputs that are omitted if no run has their channel.
    - ``normalised``: whether forces are normalised outputs, so that inertias and drags contain no newtons.
    - ``per_inertia``: force letters of the equations that are divided by their inertia, because no run determines a
      force in them. The terms of these equations are accelerations.
    """

    name: str
    title: str
    dofs: tuple[str, ...]
    free: tuple[str, ...]
    known: Mapping[str, float]
    inputs: Mapping[str, tuple[tuple[str, float | str], ...]]
    coriolis: bool = True
    normalised: bool = False
    start: Mapping[str, float] = field(default_factory=dict)
    optional: tuple[str, ...] = ()
    per_inertia: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check(self)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters: the free ones first, then the known ones."""
        return (*self.free, *self.known)

    def fixing(self, values: Mapping[str, float]) -> Form:
        """Return the form with the parameters in *values* fixed at these values."""
        return replace(
            self,
            free=tuple(n for n in self.free if n not in values),
            known={**self.known, **{n: float(v) for n, v in values.items()}},
        )

    def knowing(self, values: Mapping[str, float]) -> Form:
        """Return the form with the user-supplied constants *values* of the craft.

        Raises
        ------
        UsageError
            *values* contain a mass, but no force of the equations is in newtons.
        """
        masses = [f"{n} = {v:g}" for n, v in values.items() if n in RIGID_BODY]
        if masses and (self.per_inertia or self.normalised):
            why = "forces are fractions of full output"
            if self.per_inertia:
                why = f"its equations of {', '.join(self.per_inertia)} are per unit of inertia"
            raise UsageError(
                f"{', '.join(masses)} cannot be used in form '{self.name}', because {why} and no force is in "
                "newtons. Remove it, or use a form whose inputs are forces (--dof horizontal)"
            )
        return self.fixing(values)

    def unit_of(self, name: str, inputs: Mapping[str, str]) -> str:
        """Return the unit of a parameter; *inputs* maps input names to their units."""
        return unit_of(name, inputs, normalised=self.normalised, per_inertia=self.per_inertia)

    def freeing(self, *names: str) -> Form:
        """Return the form with the known (or new) parameters *names* free. Their known values become start values."""
        start = {**self.start, **{n: self.known[n] for n in names if n in self.known}}
        known = {n: v for n, v in self.known.items() if n not in names}
        free = (*self.free, *(n for n in names if n not in self.free))
        return replace(self, free=free, known=known, start=start)

    def driven_by(self, channels: Collection[str]) -> Form:
        """Return the form without those ``optional`` inputs that are not among *channels*."""
        absent = {c for c in self.optional if c not in channels}
        return replace(self, inputs={c: g for c, g in self.inputs.items() if c not in absent}, optional=())

    def scaling_inputs(self) -> Form:
        """Return the form with a free gain ``k_X`` (force per unit of input) for every input whose gain is 1."""
        inputs = {
            c: tuple((f, f"k_{f}" if g == 1.0 and f == c else g) for f, g in pairs) for c, pairs in self.inputs.items()
        }
        gains = [g for pairs in inputs.values() for _, g in pairs if isinstance(g, str) and g not in self.parameters]
        return replace(self, inputs=inputs, free=(*self.free, *gains))

    @property
    def is_in_newtons(self) -> bool:
        """Whether an inertia is fully known, so that a run with normalised outputs determines the forces in newtons."""
        rigid = {"X": "m", "Y": "m", "Z": "m", "K": "I_x", "M": "I_y", "N": "I_z"}
        for dof in (DOFS[d] for d in self.dofs):
            added = f"{dof.force}_{dof.velocity}dot"
            if added not in self.free and rigid[dof.force] not in self.free and added in self.known:
                return True
        return False

    @property
    def in_shares(self) -> Form | None:
        """This form of surge, sway and yaw, with each equation relative to full output of its own force.

        The result is None if the form cannot be converted. A momentum then has different numbers in two equations. The
        products that the Coriolis term forms from one inertia are therefore separate parameters, ``X_vr``, ``Y_ur``,
        ``N_uv``. An equation without an input is per unit of its inertia. A mass in kg is not possible.

        An off-diagonal inertia appears in sway only. In yaw it cannot be distinguished from ``N_v`` and ``N_r``,
        because the acceleration of an undriven sway depends on ``v``, ``r`` and ``u r``.
        """
        forces = {DOFS[d].force: DOFS[d].velocity for d in self.dofs}
        given = [n for n in self.known if n not in RIGID_BODY and n not in SPECIAL]
        gains = [g for pairs in self.inputs.values() for _, g in pairs if g != 1.0]
        if set(self.dofs) != {"surge", "sway", "yaw"} or given or gains:
            return None
        driven = {force for pairs in self.inputs.values() for force, _ in pairs}
        alone = {f"{force}_{nu}dot": -1.0 for force, nu in forces.items() if force not in driven}
        if "Y_rdot" in self.free:
            alone["N_vdot"] = 0.0
        products = ("X_vr", "Y_ur", "N_uv")
        kept = [n for n in self.free if n not in RIGID_BODY and n not in alone]
        return replace(
            self,
            title=f"{self.title}, with each force as normalised output",
            free=tuple(dict.fromkeys((*kept, *products))),
            known={**{n: v for n, v in self.known.items() if n in SPECIAL}, **alone},
            coriolis=False,
            normalised=True,
            per_inertia=tuple(force for force in forces if force not in driven),
        )

    def without(self, *names: str) -> Form:
        """Return the form without the parameters *names*, whose terms are then zero."""
        return replace(
            self,
            free=tuple(n for n in self.free if n not in names),
            known={n: v for n, v in self.known.items() if n not in names},
        )


def _check(form: Form) -> None:
    if not form.dofs or list(form.dofs) != [d for d in _ORDER if d in form.dofs]:
        raise BadFile(f"form '{form.name}': dofs must be some of {', '.join(_ORDER)}, in this order, not {form.dofs}")
    twice = {n for n in form.parameters if form.parameters.count(n) > 1}
    if twice:
        raise BadFile(f"form '{form.name}': {', '.join(sorted(twice))} is both free and known. List it only once")
    odd = set(form.per_inertia) - {DOFS[d].force for d in form.dofs}
    if odd:
        raise BadFile(
            f"form '{form.name}': per_inertia contains {', '.join(sorted(odd))}, which is not among its equations"
        )
    strange = set(form.optional) - set(form.inputs)
    if strange:
        raise BadFile(
            f"form '{form.name}': optional contains {', '.join(sorted(strange))}, which is not among its inputs"
        )
    pushed = {force for pairs in form.inputs.values() for force, _ in pairs}
    if not pushed <= set(FORCES):
        nowhere = ", ".join(sorted(pushed - set(FORCES)))
        raise BadFile(f"form '{form.name}': an input drives {nowhere}. Use one of {', '.join(FORCES)}")
    gains = {g.lstrip("-") for pairs in form.inputs.values() for _, g in pairs if isinstance(g, str)}
    missing = gains - set(form.parameters)
    if missing:
        raise BadFile(
            f"form '{form.name}': input gain {', '.join(sorted(missing))} is neither free nor known. Add it to "
            "one of them"
        )
    rows = {FORCES.index(DOFS[d].force) for d in form.dofs}
    for name in form.parameters:
        if name in RIGID_BODY or name in SPECIAL or name in gains:
            continue
        inertia = inertia_of(name)
        row = inertia.row if inertia is not None else term_of(name, tuple(form.inputs)).row
        if row not in rows:
            raise BadFile(
                f"form '{form.name}': {name} belongs to an equation of a degree of freedom that the form lacks. "
                f"Its dofs are {', '.join(form.dofs)}"
            )
    centre = [n for n in ("x_G", "y_G", "z_G") if n in form.free]
    if centre and "m" in form.free:
        raise BadFile(
            f"form '{form.name}': m and {', '.join(centre)} cannot both be free, because only their product is "
            "identifiable"
        )


def form_from(data: Mapping[str, Any], origin: str) -> Form:
    """Return the form that *data*, the contents of the form file *origin*, describes.

    Raises
    ------
    BadFile
        There are unknown keys, names that are no derivatives, or equations without their degree of freedom.
    """
    contents = conformed(data, FormData, origin)
    return form_of(contents, origin)


def form_of(contents: FormData, origin: str) -> Form:
    """Return the form in the *contents* of a form file. Exceptions are those of :func:`form_from`."""
    try:
        return Form(
            name=contents.name,
            title=contents.title or contents.name,
            dofs=tuple(contents.dofs),
            free=tuple(contents.free),
            known=dict(contents.known),
            inputs={channel: tuple(gains.items()) for channel, gains in contents.inputs.items()},
            coriolis=contents.coriolis,
            normalised=contents.normalised,
            start=dict(contents.start),
            optional=tuple(contents.optional),
            per_inertia=tuple(contents.per_inertia),
        )
    except ValueError as error:  # a name that is not that of a derivative
        raise BadFile(f"{origin}: {error}") from error


def load_form(path: Path) -> Form:
    """Read a form file (TOML).

    Raises
    ------
    BadFile
        The file is not readable, not TOML, or not a form.
    """
    return form_from(load_toml(path, "a form"), str(path))


def _shipped() -> dict[str, Form]:
    folder = resources.files("gcs_autotune.models.coupled") / "forms"
    forms = {}
    for file in sorted(folder.iterdir(), key=lambda f: f.name):
        if file.name.endswith(".toml"):
            form = form_from(parse(file.read_bytes(), "toml"), file.name)
            forms[form.name] = form
    return forms


FORMS: Mapping[str, Form] = _shipped()
"""Forms supplied with this package, by name; a new one is one file in ``forms/``."""
