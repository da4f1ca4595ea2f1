"""Equations of motion as numbers, ``M nu_dot + C(nu) nu = sum of terms``.

``C`` follows from ``M`` (Fossen2011, (3.46)) or is zero.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, ExtendedSimulator, columns_of
from gcs_autotune.errors import BadFile
from gcs_autotune.identify import ModelFile
from gcs_autotune.models import (
    DEPTH,
    ETA,
    INPUT,
    INPUT_SIZE,
    NU_SIZE,
    PAYLOAD,
    PAYLOADS,
    SPECIAL,
    STATES,
    inertia_matrix,
    program_of,
)

__all__ = ["ForceTerm", "MotionEquations", "equations_of"]

Array = NDArray[np.float64]

POSITIONS = ("x", "y", "z", "phi", "theta", "psi")
SHAPES = ("sin(phi)", "sin(theta)", "sin(psi)", "cos(psi)")
WITHIN = ("delay", "lag")
"""Names of constants that are not forces and are exported."""
AT_THE_INPUT = {"input-delay": "delay", "actuator-lag": "time_constant"}
"""Slug of an effect that is exported as a delay or lag of its input -> parameter with the time."""


FORCE_WORDS = tuple(f"the force in {dof}" for dof in ("surge", "sway", "heave")) + tuple(
    f"the moment in {dof}" for dof in ("roll", "pitch", "yaw")
)
"""Words for the forces in rows 0 (X) to 5 (N). A letter would read as a unit."""


@dataclass(frozen=True, slots=True)
class ForceTerm:
    """A force ``coefficient * factors`` in row 0 (X) to 5 (N), with factors such as ``u``, ``abs(r)``, ``sin(phi)``
    and ``N``.
    """

    row: int
    coefficient: float
    factors: tuple[str, ...]

    @property
    def text(self) -> str:
        """The product as an expression that is valid in Python and in MATLAB."""
        return " * ".join((f"({self.coefficient!r})", *self.factors))


@dataclass(frozen=True, slots=True, eq=False)
class MotionEquations:
    """The equations of motion in SNAME axes, SI units and radians.

    Attributes
    ----------
    rows : indices (0 to 5) of the equations that exist.
    inertia : M (6, 6), zero in other rows.
    rigid : rigid-body part of M (6, 6), zero if only the sum is known.
    terms : all forces, including those of the inputs.
    inputs : channel -> unit.
    full : channel -> value at full output, if known.
    delay, lag : channel -> seconds.
    parameters : (name, value, unit, standard error) of the model, the error NaN if unknown.
    left : sentences about elements of the model that are not in these equations.
    """

    name: str
    rows: tuple[int, ...]
    inertia: Array
    rigid: Array
    coriolis: bool
    terms: tuple[ForceTerm, ...]
    inputs: Mapping[str, str]
    full: Mapping[str, float]
    delay: Mapping[str, float]
    lag: Mapping[str, float]
    parameters: tuple[tuple[str, float, str, float], ...]
    left: tuple[str, ...]

    def words_of(self, term: ForceTerm) -> str:
        """Return the force *term* as text for people. A constant one has its unit."""
        unit = ""
        if not term.factors:
            unit = " of full output" if set(self.inputs.values()) == {"1"} else " N m" if term.row >= 3 else " N"
        return f"{FORCE_WORDS[term.row]}: {' * '.join((f'{term.coefficient:.6g}', *term.factors))}{unit}"

    @property
    def identifier(self) -> str:
        """Name of the model as a valid identifier."""
        plain = re.sub(r"\W+", "_", self.name).strip("_").lower() or "craft"
        return plain if plain[0].isalpha() else f"craft_{plain}"

    def acceleration(self, nu: Array, eta: Array, inputs: Mapping[str, float]) -> Array:
        """Return nu_dot (6,) for the velocity *nu* (6,), position *eta* (6,) and *inputs*.

        It is zero in rows not in :attr:`rows`.
        """
        known = dict(zip(STATES, nu, strict=True)) | dict(zip(POSITIONS, eta, strict=True)) | dict(inputs)
        force = np.zeros(6)
        for term in self.terms:
            force[term.row] += term.coefficient * np.prod([_value(f, known) for f in term.factors])
        if self.coriolis:
            a, b = np.split(self.inertia @ nu, 2)
            force[:3] -= np.cross(nu[3:], a)
            force[3:] -= np.cross(nu[:3], a) + np.cross(nu[3:], b)
        found, rows = np.zeros(6), list(self.rows)
        found[rows] = np.linalg.solve(self.inertia[np.ix_(rows, rows)], force[rows])
        return found


_CALL = re.compile(r"(abs|sin|cos)\((\w+)\)")


def _value(factor: str, known: Mapping[str, float]) -> float:
    call = _CALL.fullmatch(factor)
    return float(getattr(np, call[1])(known[call[2]]) if call else known[factor])


def equations_of(file: ModelFile, full_scale: Mapping[str, float]) -> MotionEquations:
    """Return the equations of the model in *file*, including effects that are forces, delays or lags.

    full_scale : input -> value at full output. It overrides the value in *file*.

    Raises
    ------
    BadFile
        An input name is not a valid identifier.
    """
    model = file.model
    simulator = ExtendedSimulator(model.base.form, model.effects)
    form, theta = simulator.form, simulator.extended_theta(model.base.theta, model.effects)
    program, inputs = program_of(form), tuple(form.inputs)
    strange = [c for c in inputs if not _NAME.fullmatch(c)]
    if strange:
        raise BadFile(
            f"the model's input {_plain(', '.join(strange))} has an invalid name. Use letters, digits and underscores"
        )
    units = {c: _plain(file.inputs.get(c, "")) for c in inputs}
    values = dict(zip(form.parameters, (float(v) for v in theta), strict=True))
    left = [f"{n} = {values[n]:.6g} {SPECIAL[n]}" for n in SPECIAL if values.get(n) and n not in WITHIN]
    left += [f"the input {c}" for c in (PAYLOAD, *PAYLOADS, DEPTH) if c in inputs]
    terms = []
    for row, par, scale, coefficient, factors in zip(
        program.rows, program.pars, program.scales, program.coefs, program.factors, strict=True
    ):
        size = float(coefficient) * (theta[par] if par >= 0 else 1.0) * (theta[scale] if scale >= 0 else 1.0)
        names = tuple(_factor(int(code), inputs) for code in factors if code >= 0)
        if "" in names:
            left.append(f"{FORCE_WORDS[row]}, that grows towards the bottom: {size:.6g}")
        elif size:
            terms.append(ForceTerm(int(row), float(size), names))
    delay = dict.fromkeys(inputs, values.get("delay", 0.0))
    lag = dict.fromkeys(inputs, values.get("lag", 0.0))
    for effect in model.effects:
        entry = EFFECTS[effect.slug]
        channels = [c for c in inputs if not effect.place or c in columns_of(effect.place)]
        if effect.slug in AT_THE_INPUT and channels:
            late = delay if effect.slug == "input-delay" else lag
            late.update({c: late[c] + effect.values[AT_THE_INPUT[effect.slug]] for c in channels})
        elif not entry.derivatives(effect) or "motion" not in entry.acts_on:
            numbers = ", ".join(f"{n} {v:.6g}" for n, v in effect.values.items())
            left.append(f"{effect.slug}@{effect.place} ({numbers})")
    return MotionEquations(
        name=_plain(file.name),
        rows=tuple(int(r) for r in program.active),
        inertia=inertia_matrix(form, theta),
        rigid=_rigid(values, tuple(int(r) for r in program.active)),
        coriolis=form.coriolis,
        terms=tuple(terms),
        inputs=units,
        full=_full(file, inputs, units, full_scale),
        delay=delay,
        lag=lag,
        parameters=_parameters(file),
        left=tuple(map(_plain, left)),
    )


_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_STRANGE = re.compile(r"[^\w .,;:=@()^/*|+-]+", re.ASCII)


def _plain(text: str) -> str:
    """Return a file's words without characters that could end a comment or a string of a program."""
    return _STRANGE.sub("_", text).replace("*/", "* /").replace("--", "- -")


def _factor(code: int, inputs: tuple[str, ...]) -> str:
    """Return a factor as text; empty if it is omitted."""
    if code >= INPUT_SIZE:
        return f"abs({inputs[code - INPUT_SIZE]})"
    if code >= INPUT:
        return inputs[code - INPUT]
    if code >= ETA + 6:
        return SHAPES[code - ETA - 6] if code - ETA - 6 < len(SHAPES) else ""
    if code >= ETA:
        return POSITIONS[code - ETA]
    return f"abs({STATES[code - NU_SIZE]})" if code >= NU_SIZE else STATES[code]


def _rigid(values: Mapping[str, float], rows: tuple[int, ...]) -> Array:
    """Return the rigid-body part of the inertia, as far as the model contains it, with its centre at the origin."""
    own = np.zeros((6, 6))
    for row, name in enumerate(("m", "m", "m", "I_x", "I_y", "I_z")):
        if row in rows:
            own[row, row] = values.get(name, 0.0)
    return own


def _full(
    file: ModelFile, inputs: tuple[str, ...], units: Mapping[str, str], given: Mapping[str, float]
) -> dict[str, float]:
    """Return the known values of the inputs at full output."""
    known = {c: float(v) for c, v in file.model.amplitude.items() if c in inputs}
    shares = {c: 1.0 for c in inputs if units[c] == "1"}
    return {**known, **shares, **{c: v for c, v in given.items() if c in inputs}}


def _parameters(file: ModelFile) -> tuple[tuple[str, float, str, float], ...]:
    """Return (name, value, unit, standard error) of the base model's parameters, then of the effects'."""
    base = file.model.base
    std = dict(zip(file.names, np.sqrt(np.maximum(np.diag(file.covariance), 0.0)), strict=False))
    units = {c: file.inputs.get(c, "") for c in base.form.inputs}
    rows = [(n, float(base[n]), base.form.unit_of(n, units), std.get(n, np.nan)) for n in base.form.parameters]
    for effect in file.model.effects:
        quantities = {q.name: q.unit for q in EFFECTS[effect.slug].parameters}
        for name, value in effect.values.items():
            label = f"{effect.slug}@{effect.place}.{name}"
            rows.append((label, float(value), quantities.get(name, ""), std.get(label, np.nan)))
    return tuple((n, v, u, float(s)) for n, v, u, s in rows)
