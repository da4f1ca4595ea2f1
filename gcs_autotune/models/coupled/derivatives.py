"""Parse SNAME derivative names as terms of the equations of motion.

============  ==========================================================  ==========================
name          meaning                                                     term
============  ==========================================================  ==========================
``X_udot``    added mass: force per acceleration (negative)               ``-X_udot`` in M
``Y_rdot``    off-diagonal added mass; the mirror entry ``N_vdot`` is     ``-Y_rdot`` in M, twice
              equal unless it is given as well
``X_u``       linear derivative (negative when it damps)                  ``X_u * u``
``X_uu``      two equal letters: with modulus                             ``X_uu * |u| u``
``N_rrr``     three equal letters: the cube                               ``N_rrr * r^3``
``N_uv``      different letters: plain product                            ``N_uv * u v``
``Y_|v|r``    bars: the modulus of that letter                            ``Y_|v|r * |v| r``
``X_0``       constant force                                              ``X_0``
``K_phi``     restoring, linear in an angle or in ``z``                   ``K_phi * phi``
``K_sinphi``  restoring of a weight below buoyancy                        ``K_sinphi * sin(phi)``
``N_sinpsi``  depends on the heading, likewise ``N_cospsi``               ``N_sinpsi * sin(psi)``
``Z_nearw``   grows towards the bottom: ``exp((z - bottom) / reach)``     ``Z_nearw * near * w``
``Y_delta``   input derivative; ``N_uudelta``: with ``|u| u``             ``Y_delta * delta``
============  ==========================================================  ==========================

Rigid body: ``m``, ``I_x``, ``I_y``, ``I_z``, ``I_xz``, ``x_G``, ``y_G``, ``z_G`` (Fossen2011, (3.44)).

These parameters are not forces:

- ``delay`` [s] and ``lag`` [s] (first-order): of all inputs.
- ``V_x``, ``V_y``: the current [m/s] towards north and east.
- ``drift_x``, ``drift_y``: a current that measured velocities do not include, because they are through the water.
- ``A_psi``, ``B_psi``, ``C_psi`` [rad]: the deviation of the compass (:mod:`.compass`).
- ``x_P``, ``y_P`` [m]: the place of the sensor of position and velocity (:mod:`.lever_arm`).
- ``bottom`` [m]: depth of the bottom. ``reach`` [m]: height above it over which the bottom has an effect.
- ``wall_X`` ... ``wall_N``: relative increase of the drag at the bottom in that equation.

Some inputs do not drive the craft. ``payload`` multiplies the inertia over time, ``payload_X`` to ``payload_N`` that of
one equation. ``depth`` [m] replaces ``z`` if heave is not simulated. ``surge``, ``sway`` and ``yaw`` replace ``u``,
``v`` and ``r`` if these were only measured.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.errors import BadFile
from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.compass import COEFFICIENTS
from gcs_autotune.models.coupled.lever_arm import LEVER_ARM
from gcs_autotune.notebook import Displayed

__all__ = [
    "DEPTH",
    "FORCES",
    "PAYLOAD",
    "PAYLOADS",
    "RIGID_BODY",
    "SEEN",
    "SPECIAL",
    "STATES",
    "WALLS",
    "Inertia",
    "Term",
    "inertia_of",
    "term_of",
    "unit_of",
]

FORCES = ("X", "Y", "Z", "K", "M", "N")
"""Force letters in SNAME order. The index of a letter is the row of its equation."""

STATES = ("u", "v", "w", "p", "q", "r")
"""Velocity letters in SNAME order. The index of a letter is its column in the inertia matrix."""

RIGID_BODY: Mapping[str, str] = {
    "m": "kg",
    "I_x": "kg m^2",
    "I_y": "kg m^2",
    "I_z": "kg m^2",
    "I_xz": "kg m^2",
    "x_G": "m",
    "y_G": "m",
    "z_G": "m",
}
"""Rigid-body constant -> unit."""

WALLS = tuple(f"wall_{force}" for force in FORCES)
"""Names of the parameters for the relative increase of drag at the bottom, one for each row."""

SPECIAL: Mapping[str, str] = {
    **dict.fromkeys(("delay", "lag"), "s"),
    **dict.fromkeys(("V_x", "V_y", "drift_x", "drift_y"), "m/s"),
    **dict.fromkeys(COEFFICIENTS, "rad"),
    **dict.fromkeys(LEVER_ARM, "m"),
    **dict.fromkeys(("reach", "bottom"), "m"),
    **dict.fromkeys(WALLS, "1"),
}
"""Parameter that is neither force nor inertia -> unit."""

PAYLOAD, DEPTH = "payload", "depth"
"""Names of the input that multiplies the inertia, and of the input that replaces ``z``."""

PAYLOADS = tuple(f"payload_{force}" for force in FORCES)
"""Names of the inputs that multiply the inertia of one row, in place of ``payload``."""

SEEN: Mapping[str, str] = {"u": "surge", "v": "sway", "w": "heave", "p": "roll", "q": "pitch", "r": "yaw"}
"""Velocity -> name of the input that replaces it if it is measured and not simulated."""

_POSITIONS = {"x": 12, "y": 13, "z": 14, "phi": 15, "theta": 16, "psi": 17}
_SHAPES = {
    "sinphi": kernel.SIN_PHI,
    "sintheta": kernel.SIN_THETA,
    "sinpsi": kernel.SIN_PSI,
    "cospsi": kernel.COS_PSI,
    "near": kernel.NEAR,
}
_ANGULAR = {"p", "q", "r"}
_NAME = re.compile(r"^(?P<force>[XYZKMN])_(?P<rest>.+)$")


@dataclass(frozen=True, slots=True)
class Term(Displayed):
    """A force ``coefficient * factors`` in one row. ``factors`` are at most three codes of :mod:`.kernel`."""

    row: int
    factors: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Inertia(Displayed):
    """An added-mass derivative. Its value times -1 is the element (row, column) of M."""

    row: int
    column: int


def inertia_of(name: str) -> Inertia | None:
    """Return the element of M for the added-mass derivative *name*, or None for any other name."""
    match = _NAME.match(name)
    if match is None or not match["rest"].endswith("dot"):
        return None
    state = match["rest"].removesuffix("dot")
    if state not in STATES:
        raise BadFile(f"'{name}' is not a derivative, because 'dot' must follow one of {', '.join(STATES)}")
    return Inertia(FORCES.index(match["force"]), STATES.index(state))


def term_of(name: str, inputs: Sequence[str]) -> Term:
    """Return the force term of the derivative *name*.

    Raises
    ------
    BadFile
        *name* has none of the forms in the table of this module.
    """
    match = _NAME.match(name)
    if match is None:
        raise BadFile(f"'{name}' is neither a derivative (X_u, Y_vv, N_rdot, N_delta ...) nor a known constant")
    row, rest = FORCES.index(match["force"]), match["rest"]
    if rest == "0":
        return Term(row, ())
    factors = _factors(name, rest, inputs)
    if not 1 <= len(factors) <= 3:
        raise BadFile(f"'{name}' has {len(factors)} factors. Use one to three")
    return Term(row, tuple(factors))


def _tokens(name: str, rest: str, inputs: Sequence[str]) -> list[tuple[str, bool]]:
    words = sorted([*STATES, *_POSITIONS, *_SHAPES, *inputs], key=len, reverse=True)
    found: list[tuple[str, bool]] = []
    while rest:
        modulus = rest.startswith("|")
        rest = rest[1:] if modulus else rest
        word = next((w for w in words if rest.startswith(w)), None)
        if word is None or (modulus and not rest[len(word) :].startswith("|")):
            raise BadFile(f"'{name}': cannot read '{rest}'. Use one of {', '.join(words)}")
        rest = rest[len(word) + modulus :]
        found.append((word, modulus))
    return found


def _factors(name: str, rest: str, inputs: Sequence[str]) -> list[int]:
    tokens = _tokens(name, rest, inputs)
    codes: list[int] = []
    for i, (word, modulus) in enumerate(tokens):
        same = [j for j, (other, _) in enumerate(tokens) if other == word]
        pair = len(same) == 2 and same[0] == i and tokens[same[1]] == (word, False) and same[1] == i + 1
        codes.append(_code(word, modulus or pair, inputs))
    return codes


def _code(word: str, modulus: bool, inputs: Sequence[str]) -> int:
    if word in STATES:
        return STATES.index(word) + (kernel.NU_SIZE if modulus else kernel.NU)
    if word in inputs:
        return list(inputs).index(word) + (kernel.INPUT_SIZE if modulus else kernel.INPUT)
    if word in _SHAPES:
        return _SHAPES[word]
    return _POSITIONS[word]


def unit_of(
    name: str, inputs: Mapping[str, str], *, normalised: bool = False, per_inertia: Collection[str] = ()
) -> str:
    """Return the unit of the parameter *name*.

    inputs : name of the input -> unit.
    normalised : whether forces are known only as fractions, so that ``N`` and ``N m`` do not appear.
    per_inertia : force letters of the equations divided by their inertia, in which forces are accelerations.
    """
    if name in SPECIAL:
        return SPECIAL[name]
    if name in RIGID_BODY:
        return "1" if per_inertia else RIGID_BODY[name]
    gain = name.startswith("k_")
    if gain and name[2:3] in per_inertia:
        return _acceleration(name[2], [], [next(iter(inputs.values()), "1")])
    if gain:
        return "1"
    match = _NAME.match(name)
    if match is None:
        return ""
    if match["force"] in per_inertia:
        return "1" if inertia_of(name) is not None else _per_inertia(name, match, inputs)
    force = "" if normalised else ("N" if FORCES.index(match["force"]) < 3 else "N m")
    inertia = inertia_of(name)
    if inertia is not None:
        return _joined(force, 2, ["rad" if STATES[inertia.column] in _ANGULAR else "m"])
    if match["rest"] == "0":
        return force or "1"
    seconds, lower = 0, []
    for word, _ in _tokens(name, match["rest"], tuple(inputs)):
        if word in STATES:
            seconds += 1
            lower.append("rad" if word in _ANGULAR else "m")
        elif word in inputs:
            lower.append(inputs[word])
        elif word in _POSITIONS:
            lower.append("m" if word in "xyz" else "rad")
    return _joined(force, seconds, [w for w in lower if w != "1"])


def _per_inertia(name: str, match: re.Match[str], inputs: Mapping[str, str]) -> str:
    if match["rest"] == "0":
        return _acceleration(match["force"], [], [])
    words = [word for word, _ in _tokens(name, match["rest"], tuple(inputs))]
    rates = ["rad" if w in _ANGULAR else "m" for w in words if w in STATES]
    others = [inputs[w] for w in words if w in inputs]
    others += ["m" if w in "xyz" else "rad" for w in words if w in _POSITIONS]
    return _acceleration(match["force"], rates, [w for w in others if w != "1"])


def _acceleration(force: str, rates: Sequence[str], others: Sequence[str]) -> str:
    """Return the unit of an acceleration per product of velocities (*rates*) and other factors (*others*)."""
    powers: dict[str, int] = {"m" if FORCES.index(force) < 3 else "rad": 1}
    for word in (*rates, *others):
        powers[word] = powers.get(word, 0) - 1
    powers["s"] = len(rates) - 2
    above, below = ([(w, abs(p)) for w, p in powers.items() if p * sign > 0] for sign in (1, -1))
    text = [" ".join(w if p == 1 else f"{w}^{p}" for w, p in part) for part in (above, below)]
    bottom = f"({text[1]})" if len(below) > 1 else text[1]
    return (text[0] or "1") + (f"/{bottom}" if bottom else "")


def _joined(force: str, seconds: int, lower: Sequence[str]) -> str:
    top = " ".join(([force] if force else []) + ([f"s^{seconds}" if seconds > 1 else "s"] if seconds else []))
    parts = []
    for word in dict.fromkeys(lower):
        power = list(lower).count(word)
        text = f"({word})" if "/" in word or " " in word else word
        parts.append(text if power == 1 else f"{text}^{power}")
    bottom = parts[0] if len(parts) == 1 else f"({' '.join(parts)})"
    return (top or "1") + (f"/{bottom}" if parts else "")
