"""Hydrodynamic forces proportional to products of velocities: one family, generated systematically.

:func:`product_terms` lists every product of one or two velocities (three on request), with moduli, that a hull with
port-starboard symmetry can have. It also lists the products for a craft that pulls to one side. The terms are those of
Abkowitz1964 (odd and even powers), of Norrbin1971 (moduli, equal for headway and sternway) and of Fossen2011 (chapter
6). Each is a SNAME derivative.

Some of these terms are other effects: linear and quadratic drag, the couplings of :mod:`.hydrodynamics`, and the named
effects in this module. :class:`VelocityProduct` is any other term. A velocity that the model simulates enters as
simulated. A velocity that was only measured enters as an input.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from math import inf, prod
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import Drive, Effect, EffectInstance, Quantity
from gcs_autotune.effects.summary import DataSummary, force_scale, force_unit, sense, top_speed
from gcs_autotune.models import FORCES, SEEN, STATES, Form, Term, inertia_of, term_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import DOFS

__all__ = [
    "VELOCITY_PRODUCT",
    "MunkMoment",
    "ProductTerm",
    "SpeedDamping",
    "SwayMoment",
    "VelocityProduct",
    "name_of",
    "product_terms",
    "term_named",
    "twins_of",
]

ODD = frozenset("vprYKN")
"""Velocities and forces that change sign when a craft is mirrored from port to starboard."""

ONE_SIDED = frozenset({"N_u", "N_|u|u", "Y_u", "Y_|u|u"})
"""Derivatives of a craft that pulls to one side when moving.

A hull with port-starboard symmetry does not have them, but many boats do.
"""

Factor = tuple[str, bool]
"""Type of a factor: a velocity, and whether its modulus is taken."""


@dataclass(frozen=True, slots=True)
class ProductTerm(Displayed):
    """A force or moment per product of velocities.

    - ``derivative``: SNAME name of the term.
    - ``row``: the force or moment.
    - ``factors``: the velocities, those with modulus first.
    - ``words``: a description.
    - ``source``: the reference.
    - ``damps``: whether the term takes energy out of its own motion, so that its sign is known.
    """

    derivative: str
    row: str
    factors: tuple[Factor, ...]
    words: str
    source: str
    damps: bool

    @property
    def own(self) -> str:
        """Velocity of the degree of freedom in which the term acts."""
        return STATES[FORCES.index(self.row)]

    @property
    def code(self) -> Term:
        """The term with sorted factors, independent of its spelling."""
        return canonical(self.derivative)


def canonical(derivative: str, inputs: Sequence[str] = ()) -> Term:
    """Return the term of *derivative* with sorted factors, so that ``N_rr`` and ``N_|r|r`` are equal."""
    term = term_of(derivative, inputs)
    return Term(term.row, tuple(sorted(term.factors)))


NAMES: Mapping[str, tuple[str, str]] = {
    "X_vr": ("surge force of the sideways momentum in a turn (mass and added mass in sway)", "Fossen2011"),
    "X_|v||v|": ("resistance to sliding sideways", "Abkowitz1964"),
    "X_|r||r|": ("resistance to turning (centre of mass ahead, tangential flow)", "Abkowitz1964"),
    "X_|v|u": ("resistance that grows with sliding sideways", "Norrbin1971"),
    "X_|r|u": ("resistance that grows with turning", "Norrbin1971"),
    "Y_r": ("sideways force caused by turning", "Abkowitz1964"),
    "Y_uv": ("lift of a hull at a drift angle", "Norrbin1971"),
    "Y_|u|v": ("sway damping that grows with speed: lift and drag of a hull at a drift angle", "Norrbin1971"),
    "Y_ur": ("sideways force of the forward momentum in a turn (mass and added mass in surge)", "Fossen2011"),
    "Y_|u|r": ("lift of a turning hull", "Norrbin1971"),
    "Y_|v|r": ("cross-flow: sideways force caused by turning while sliding", "Fossen2011"),
    "Y_|r|v": ("cross-flow: sway damping that grows with turning", "Fossen2011"),
    "Y_|r|r": ("cross-flow: sideways force caused by fast turning", "Fossen2011"),
    "N_v": ("moment caused by sliding sideways", "Abkowitz1964"),
    "N_uv": ("Munk moment of a hull at a drift angle", "Fossen2011"),
    "N_|u|v": ("moment of the lift of a hull at a drift angle", "Norrbin1971"),
    "N_ur": ("moment of a turning hull under way, with opposite signs ahead and astern", "Fossen2011"),
    "N_|u|r": ("yaw damping that grows with speed, ahead and astern", "Norrbin1971"),
    "N_|v|v": ("cross-flow: moment caused by fast sideways motion", "Fossen2011"),
    "N_|v|r": ("cross-flow: yaw damping that grows with sliding sideways", "Fossen2011"),
    "N_|r|v": ("cross-flow: moment caused by sliding sideways while turning", "Fossen2011"),
    "N_u": ("pull to one side that grows with speed", "Abkowitz1964"),
    "N_|u|u": ("pull to one side that grows with the square of speed", "Abkowitz1964"),
    "Y_u": ("push to one side that grows with speed", "Abkowitz1964"),
    "Y_|u|u": ("push to one side that grows with the square of speed", "Abkowitz1964"),
    "Z_|u||u|": ("lift or sinkage caused by speed ahead", "Fossen2011"),
    "Z_uw": ("lift of a hull at an angle of attack", "Fossen2011"),
    "M_uw": ("Munk moment of a hull at an angle of attack", "Fossen2011"),
}
"""Derivative -> its hydrodynamic meaning, and a source."""


def product_terms(velocities: str = "uvwpqr", order: int = 2) -> Iterator[ProductTerm]:
    """Yield the terms of all rows of *velocities* with up to *order* factors among these velocities.

    Port-starboard symmetry decides which terms exist. A product of moduli alone is yielded only if it is a square, and
    not the square of the row's own velocity. A force with that square would act in one direction only.
    """
    known = [s for s in STATES if s in velocities]
    products = [p for count in range(1, order + 1) for p in combinations_with_replacement(known, count)]
    for own, letters in product(known, products):
        for moduli in _moduli(letters, own):
            found = _term(FORCES[STATES.index(own)], own, letters, moduli)
            if found is not None:
                yield found


def _moduli(letters: Sequence[str], own: str) -> Iterator[tuple[bool, ...]]:
    """Yield which factors have moduli, each product once; products of three have none (Abkowitz1964)."""
    if len(letters) == 1:
        yield (False,)
    elif len(letters) > 2:
        yield (False,) * len(letters)
    elif letters[0] == letters[1]:
        yield (True, False)
        if letters[0] != own:
            yield (True, True)
    else:
        yield from ((False, False), (True, False), (False, True))


def _term(row: str, own: str, letters: Sequence[str], moduli: Sequence[bool]) -> ProductTerm | None:
    factors = tuple(sorted(zip(letters, moduli, strict=True), key=lambda f: not f[1]))
    rest = "".join(f"|{s}|" if size else s for s, size in factors)
    if len(factors) > 2 and len(set(letters)) == 2:
        # Two equal letters would be read as one with its modulus, so a square is written with two moduli.
        twice = next(s for s in letters if letters.count(s) == 2)
        other = next(s for s in letters if s != twice)
        factors, rest = ((twice, True), (twice, True), (other, False)), f"|{twice}||{twice}|{other}"
    derivative = f"{row}_{rest}"
    odd = sum(s in ODD for s, size in factors if not size) % 2 == 1
    if odd != (row in ODD) and derivative not in ONE_SIDED:
        return None
    signed = [s for s, size in factors if not size]
    damps = signed == [own] or (len(factors) == 3 and set(letters) == {own})
    words, source = NAMES.get(derivative, (_words(row, own, factors, damps), "Abkowitz1964"))
    return ProductTerm(derivative, row, factors, words, source, damps)


def _words(row: str, own: str, factors: Sequence[Factor], damps: bool) -> str:
    dof = DOF_OF[own]
    what = "moment" if row in "KMN" else "force"
    others = " and ".join(dict.fromkeys(DOF_OF[s] for s, _ in factors if s != own or not damps))
    if damps:
        return f"{dof} damping that grows with {others}" if others else f"{dof} damping"
    return f"{dof} {what} that grows with {others}"


DOF_OF: Mapping[str, str] = {d.velocity: d.name for d in DOFS.values()}
"""Velocity -> degree of freedom."""

TERMS: Mapping[str, ProductTerm] = {t.derivative: t for t in product_terms(order=3)}
"""Derivative -> term, for all six rows, up to three factors."""


def term_named(derivative: str) -> ProductTerm:
    """Return the term of *derivative*, in any spelling.

    Raises
    ------
    KeyError
        The family has no such term.
    """
    if derivative in TERMS:
        return TERMS[derivative]
    code = canonical(derivative)
    found = next((t for t in TERMS.values() if t.code == code), None)
    if found is None:
        raise KeyError(derivative)
    return found


# -- as effects

VARIES = 0.02
"""Least range of a measured velocity, relative to its largest value. Project choice.

A constant velocity acts like a constant force.
"""

ASTERN = 0.05
"""Least speed astern, relative to the largest speed ahead, that distinguishes ``u`` from its modulus.

Project choice.
"""

SHARE = 0.2
"""Start value of a coefficient: its force at the largest speeds, relative to the largest force. Project choice."""

LOOKED_AT = "uvr"
"""Velocities that may enter a term as measured. Other velocities enter only if they are simulated."""

SIMULATED = "simulated_"
"""Prefix of the constants ``simulated_u`` and so on, which mark velocities that the model simulates.

The other velocities are inputs, as measured.
"""

MASSES = frozenset({"X_vr", "Y_ur", "N_uv"})
"""Terms that a form with Coriolis forces derives from its masses."""


def seen_or_simulated(term: ProductTerm, data: DataSummary) -> bool:
    """Return whether every velocity of *term* is simulated, or measured with a change above its noise."""
    for letter, _ in term.factors:
        if DOF_OF[letter] in data.form.dofs:
            continue
        low, high = data.extent.get(letter, (0.0, 0.0))
        if letter not in LOOKED_AT or letter in data.still or not high - low > VARIES * max(abs(low), abs(high)):
            return False
    return True


def is_in(form: Form, term: ProductTerm) -> bool:
    """Return whether *form* already contains *term*, in any spelling."""
    if term.derivative in MASSES and form.coriolis:
        return True
    inputs = tuple(form.inputs)
    for name in form.parameters:
        if name[:2] == f"{term.row}_" and inertia_of(name) is None and canonical(name, inputs) == term.code:
            return True
    return False


def ahead_only(data: DataSummary) -> bool:
    """Return whether no recorded speed shows the craft going astern, so that ``u`` equals its modulus."""
    low, high = data.extent.get("u", (0.0, 0.0))
    return low > -ASTERN * abs(high)


class ProductEffect(Effect):
    """Effect: a force proportional to a product of velocities. A subclass defines the product and where it acts."""

    family = "hydrodynamics"
    is_structural = True

    def term(self, place: str) -> ProductTerm:
        """Return the term of the effect at *place*."""
        raise NotImplementedError

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return the constants ``simulated_u`` and so on, each 1, for the velocities that the model simulates."""
        term = self.term(place)
        letters = dict.fromkeys(s for s, _ in term.factors if s != term.own and DOF_OF[s] in data.form.dofs)
        return {f"{SIMULATED}{s}": 1.0 for s in letters}

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of the coefficient that produce a fifth of the largest force at the largest speeds.

        Both signs are returned, unless the term is a damping term.
        """
        term, (name,) = self.term(place), (q.name for q in self.parameters)
        dof = DOF_OF[term.own]
        size = SHARE * force_scale(dof, data) / prod(top_speed(DOF_OF[s], data) for s, _ in term.factors)
        signs = (-sense(dof, data)["sense"],) if term.damps else (-1.0, 1.0)
        return tuple({name: sign * size} for sign in signs)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the coefficient. It may have either sign, unless the term is a damping term."""
        term, (name,) = self.term(place), (q.name for q in self.parameters)
        if not term.damps:
            return {name: (-inf, inf)}
        return {name: (-inf, 0.0) if sense(DOF_OF[term.own], data)["sense"] > 0.0 else (0.0, inf)}

    def _measured(self, effect: EffectInstance) -> list[str]:
        term = self.term(effect.place)
        letters = dict.fromkeys(s for s, _ in term.factors if s != term.own)
        return [s for s in letters if f"{SIMULATED}{s}" not in effect.constants]

    def inputs(self, effect: EffectInstance) -> tuple[str, ...]:
        """Return the names of inputs for velocities that were only measured."""
        return tuple(SEEN[s] for s in self._measured(effect))

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Return *drive* with the measured velocities added as inputs. Between two stamps they are the mean of both."""
        for letter in self._measured(effect):
            if SEEN[letter] in drive.channels:
                continue
            own = drive.measured[letter]
            known = np.isfinite(own.values)
            drive = drive.on(np.union1d(drive.t, own.t[known]))
            middle = 0.5 * (drive.t + np.append(drive.t[1:], drive.t[-1]))
            drive = drive.with_channel(SEEN[letter], np.interp(middle, own.t[known], own.values[known]))
        return drive

    def derivatives(self, effect: EffectInstance) -> Mapping[str, float]:
        """Return the coefficient as a SNAME derivative.

        Velocities that were only measured appear in it as the inputs ``surge``, ``sway`` and ``yaw``.
        """
        term, measured = self.term(effect.place), self._measured(effect)
        words = ((SEEN[s] if s in measured else s, size) for s, size in term.factors)
        name = f"{term.row}_" + "".join(f"|{word}|" if size else word for word, size in words)
        return {name: next(iter(effect.values.values()))}

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the coefficient: force or moment per product of speeds."""
        term = self.term(place)
        turning = sum(DOFS[DOF_OF[s]].angular for s, _ in term.factors)
        powers = [("m", len(term.factors) - turning), ("rad", turning)]
        lower = [unit if power == 1 else f"{unit}^{power}" for unit, power in powers if power]
        below = f"({' '.join(lower)})" if len(lower) > 1 else lower[0]
        power = len(term.factors)
        return f"{force_unit(DOF_OF[term.own], data)} s{'' if power == 1 else f'^{power}'}/{below}"


class NamedProduct(ProductEffect):
    """Effect: a term that has its own slug. Its place is the degree of freedom in which it acts."""

    derivative: ClassVar[str]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.grows_with = (cls.derivative,)

    def term(self, place: str) -> ProductTerm:
        """Return the term of this class, which is the same at every place."""
        return TERMS[self.derivative]

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the degree of freedom of the term, if the model lacks the term and its velocities are simulated or
        measured.
        """
        term = TERMS[self.derivative]
        dof = DOF_OF[term.own]
        if dof not in data.form.dofs or not seen_or_simulated(term, data) or is_in(data.form, term):
            return ()
        return () if _in_a_coupling(term, data.form) else (dof,)


class SwayMoment(NamedProduct):
    """Effect: ``N_v v``, because a hull that moves sideways turns (SNAME).

    A positive ``N_v`` turns the bow towards the motion.
    """

    slug = "sway-moment"
    derivative = "N_v"
    meaning = "sliding sideways turns the craft, because the centre of its lateral resistance is off midships"
    plain = "Sliding sideways turns your craft, but not {simulation}."
    parameters = (Quantity("N_v", "moment s/m", "yaw moment per unit of sway velocity"),)
    shown_by = "yaw residual against the measured sway, which lasts longest after a turn has ended"
    mistaken_for = ("quadratic-drag", "speed-damping", "munk-moment", "actuator-lag")
    separated_by = "pull-outs at two speeds: a hard turn, then the rudder amidships until the craft runs straight"


class SpeedDamping(NamedProduct):
    """Effect: ``N_|u|r |u| r``, because the flow along the hull damps a turn.

    Turning is then harder at speed, ahead or astern.
    """

    slug = "speed-damping"
    derivative = "N_|u|r"
    meaning = "turning gets harder with speed, ahead or astern, because yaw damping grows with the flow"
    plain = "Your craft's turning resistance grows with speed; {simulation}'s does not."
    parameters = (
        Quantity("N_|u|r", "moment s^2/(m rad)", "yaw moment per product of speed (ahead or astern) and turn rate"),
    )
    shown_by = "yaw residual against |u| times r: turns decay faster under way than at rest"
    mistaken_for = ("quadratic-drag", "speed-dependent-steering", "sway-moment", "munk-moment", "velocity-product")
    separated_by = "the same turn at rest, at half speed and at full speed. Start each at a steady speed"


class MunkMoment(NamedProduct):
    """Effect: ``N_uv u v``, a moment on a hull at a drift angle (Munk; Fossen2011).

    Added mass alone gives ``N_uv = Y_vdot - X_udot`` < 0 (inertia positive), which turns the bow further away from the
    motion. Fins at the stern give the opposite sign.
    """

    slug = "munk-moment"
    words = "Munk moment"
    derivative = "N_uv"
    form_of = ("sway-moment",)
    meaning = "at a drift angle the flow turns the craft, further into a turn or out of it, and more at higher speed"
    plain = "Moving at an angle to its bow turns your craft, and more at speed, but not {simulation}."
    parameters = (
        Quantity(
            "N_uv",
            "moment s^2/m^2",
            "yaw moment per product of surge and sway velocity. Opposite in sign to the inertia, it turns the craft "
            "further",
        ),
    )
    shown_by = "yaw residual against u times v"
    mistaken_for = ("sway-moment", "speed-damping", "coriolis-coupling")
    separated_by = "pull-outs at two speeds. A moment caused by sway alone does not depend on the speed ahead"


NAMED = frozenset({SwayMoment.derivative, SpeedDamping.derivative, MunkMoment.derivative})


def _is_drag(term: ProductTerm) -> bool:
    """Return whether the term is linear or quadratic drag."""
    return {s for s, _ in term.factors} == {term.own} and len(term.factors) < 3


def _in_a_coupling(term: ProductTerm, form: Form) -> bool:
    """Return whether the term is part of a coupling of simulated motions that may be searched for in this form."""
    plane = {"surge", "sway", "yaw"} <= set(form.dofs)
    if term.derivative in MASSES:
        return plane and not form.coriolis and not any(is_in(form, TERMS[n]) for n in MASSES)
    if term.derivative in ("Y_r", "N_v"):
        there = {"Y_r", "N_v", "Y_rdot", "N_vdot", "x_G"} & set(form.parameters)
        return {"sway", "yaw"} <= set(form.dofs) and not there
    return False


VELOCITY_PRODUCT = "velocity-product"
"""Slug of the products of velocities that are not effects with their own slug."""


class VelocityProduct(ProductEffect):
    """Effect: ``coefficient`` times a product of velocities that is not in any other effect.

    The place is the derivative.
    """

    slug = VELOCITY_PRODUCT
    grows_with = ("coefficient",)
    meaning = "a force or moment proportional to a product of velocities that the simulation does not model"
    plain = "The motions of your craft act on each other in a way that {simulation} does not model."
    parameters = (Quantity("coefficient", "force per product", "the SNAME derivative of that product"),)
    shown_by = "residual against that product: zero at rest, largest when all its velocities are large"
    mistaken_for = ("quadratic-drag", "speed-damping", "munk-moment", "sway-yaw-coupling", "coriolis-coupling")
    yields_to = ("input-bias",)  # a product that hardly changes in the runs is a constant to them
    separated_by = (
        "turning circles both ways at two speeds, pull-outs, and the same turns astern. They vary each velocity of "
        "the product alone, then together"
    )

    def term(self, place: str) -> ProductTerm:
        """Return the term whose derivative is *place*."""
        return term_named(place)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return derivatives that the model lacks, that no other effect contains, and whose velocities are available.

        If the craft never went astern, ``u`` and its modulus are equal and have one place.
        """
        simulated = [DOFS[d].velocity for d in data.form.dofs]
        velocities = "".join(s for s in STATES if s in simulated or s in LOOKED_AT)
        found = []
        for term in product_terms(velocities):
            if DOF_OF[term.own] not in data.form.dofs or _is_drag(term) or term.derivative in NAMED:
                continue
            if is_in(data.form, term) or _in_a_coupling(term, data.form) or not seen_or_simulated(term, data):
                continue
            if ahead_only(data) and term.derivative in TWINS:
                continue
            found.append(term.derivative)
        return tuple(found)


TWINS: Mapping[str, str] = {
    "N_ur": "N_|u|r",
    "N_|u|v": "N_uv",
    "Y_|u|r": "Y_ur",
    "Y_uv": "Y_|u|v",
    "N_|u|u": "N_u",
    "Y_|u|u": "Y_u",
}
"""Derivative -> another derivative that is equal or similar if the craft moves ahead only.

Powers of a speed that hardly changes are similar.
"""


def name_of(effect: EffectInstance) -> str:
    """Return the name of *effect* in lists of causes: its slug, or the derivative if it is a velocity product."""
    return effect.place if effect.slug == VELOCITY_PRODUCT else effect.slug


def twins_of(effect: EffectInstance, data: DataSummary) -> tuple[str, ...]:
    """Return derivatives that the runs of *data* do not distinguish from *effect*, because the craft never went
    astern.
    """
    entry = OWN.get(effect.slug)
    if entry is None or not ahead_only(data):
        return ()
    derivative = entry.term(effect.place).derivative
    return tuple(other for other, kept in TWINS.items() if kept == derivative)


OWN: Mapping[str, ProductEffect] = {e.slug: e for e in (SwayMoment(), SpeedDamping(), MunkMoment(), VelocityProduct())}
"""Slug -> effect, for the effects of this family."""
