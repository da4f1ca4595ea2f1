"""Notation of this package: SNAME states and forces, their units, and all sign conventions.

Signs
-----
* Frames: NED (``x`` north, ``y`` east, ``z`` down) and the body frame FRD (forward, right, down).
* ``psi`` is measured from north over east. A positive yaw moment ``N`` turns the bow to starboard and makes
  ``r = dpsi/dt`` positive. ``z`` is depth (down positive). A positive ``Z`` pushes down. A positive ``X`` pushes ahead.
* One degree of freedom, Miskovic2010, eq. (6.33): ``alpha * nu_dot + (beta + beta_nn * |nu|) * nu = tau + Delta``.
  ``alpha`` is inertia including added mass. Drag coefficients are positive if they damp. ``Delta`` is the constant
  force
  of tether, trim, wind or net weight, with the same sign as ``tau``. If the steering input has the opposite sign (a
  rudder whose positive angle turns to port), ``alpha`` and the drag coefficients are negative.
* A rudder deflection ``delta`` (channel) is an input like ``N``. The *parameter* called ``delta`` in results is the
  ``Delta`` above.

Units
-----
All computations use SI and radians. Files contain the unit in the column heading, ``name[unit]``; :func:`to_si` lists
the accepted units. A heading without a unit means the unit of :data:`SIGNALS`. For a force or moment it means a
fraction of full actuator output, the unit ``1``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import NamedTuple

from gcs_autotune.errors import BadFile

__all__ = [
    "DOFS",
    "INPUTS",
    "OVERFULL",
    "SIDES",
    "SIGNALS",
    "Dof",
    "Signal",
    "column_unit",
    "parse_header",
    "signal_meaning",
    "to_si",
    "wrap",
]


class Signal(NamedTuple):
    """One signal: its SI unit and meaning.

    ``wraps``: whether it is an angle on a circle. ``down``: whether it increases downwards, which also applies to its
    plot.
    """

    unit: str
    meaning: str
    wraps: bool = False
    down: bool = False

    @property
    def angular(self) -> bool:
        """Whether the signal is an angle or its rate of change, which is shown in degrees."""
        return self.unit.startswith("rad")


SIGNALS: dict[str, Signal] = {
    "x": Signal("m", "north position"),
    "y": Signal("m", "east position"),
    "z": Signal("m", "depth, positive down", down=True),
    "phi": Signal("rad", "roll angle"),
    "theta": Signal("rad", "pitch angle"),
    "psi": Signal("rad", "heading, north over east", wraps=True),
    "u": Signal("m/s", "surge velocity"),
    "v": Signal("m/s", "sway velocity"),
    "w": Signal("m/s", "heave velocity"),
    "p": Signal("rad/s", "roll rate"),
    "q": Signal("rad/s", "pitch rate"),
    "r": Signal("rad/s", "yaw rate"),
    "U": Signal("m/s", "speed over ground"),
    "X": Signal("N", "surge force, or fraction of full output"),
    "Y": Signal("N", "sway force, or fraction of full output"),
    "Z": Signal("N", "heave force, or fraction of full output"),
    "K": Signal("N m", "roll moment, or fraction of full output"),
    "M": Signal("N m", "pitch moment, or fraction of full output"),
    "N": Signal("N m", "yaw moment, or fraction of full output"),
    "delta": Signal("rad", "rudder angle"),
    "n": Signal("rad/s", "propeller speed"),
    "d": Signal("m", "distance to a flat surface ahead"),
    "d_starboard": Signal("m", "distance to a flat surface ahead, second rangefinder"),
    "wall_angle": Signal("rad", "angle to a flat surface ahead, 0 at a right angle to it"),
    "psi_ref": Signal("rad", "commanded heading"),
    "z_ref": Signal("m", "commanded depth"),
    "u_ref": Signal("m/s", "commanded speed ahead"),
}
"""Signal name -> its unit and meaning."""

_ALONG: dict[tuple[str, str], str] = {("surge", "x"): "distance ahead", ("sway", "y"): "distance to starboard"}
"""(Degree of freedom identified alone, signal) -> meaning. Its position is not a position on the map."""


def signal_meaning(signal: str, dof: str = "") -> str:
    """Return the meaning of a signal in a model of *dof*; its name if it is not in :data:`SIGNALS`."""
    return _ALONG.get((dof, signal)) or SIGNALS.get(signal, ("", signal))[1]


_TO_SI: dict[str, tuple[str, float]] = {
    "": ("1", 1.0),
    "1": ("1", 1.0),
    "-": ("1", 1.0),
    "%": ("1", 0.01),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "ns": ("s", 1e-9),
    "min": ("s", 60.0),
    "m": ("m", 1.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "km": ("m", 1e3),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "m/s": ("m/s", 1.0),
    "cm/s": ("m/s", 1e-2),
    "mm/s": ("m/s", 1e-3),
    "kn": ("m/s", 1852.0 / 3600.0),
    "km/h": ("m/s", 1.0 / 3.6),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180.0),
    "deg/min": ("rad/s", math.pi / 10800.0),
    "rev/s": ("rad/s", 2.0 * math.pi),
    "rpm": ("rad/s", math.pi / 30.0),
    "1/s": ("rad/s", 2.0 * math.pi),
    "1/min": ("rad/s", math.pi / 30.0),
    "m/s^2": ("m/s^2", 1.0),
    "rad/s^2": ("rad/s^2", 1.0),
    "deg/s^2": ("rad/s^2", math.pi / 180.0),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "kgf": ("N", 9.80665),
    "N m": ("N m", 1.0),
    "Nm": ("N m", 1.0),
    "kN m": ("N m", 1e3),
    "mN m": ("N m", 1e-3),
    "V": ("V", 1.0),
    "A": ("A", 1.0),
    "Pa": ("Pa", 1.0),
    "hPa": ("Pa", 100.0),
    "pwm": ("pwm", 1.0),
    "count": ("count", 1.0),
}


_SPELLINGS: tuple[tuple[str, str], ...] = (
    (r"°|\bdegrees?\b|\bdegs\b", "deg"),
    (r"[µμ]", "u"),
    (r"²", "^2"),
    (r"⁻¹", "^-1"),
    (r"⁻²", "^-2"),
    (r"\*\*", "^"),
    (r"\s*[*·⋅×]\s*|(?<=[A-Za-z])[.-](?=[A-Za-z])", " "),
    (r"\bradians?\b", "rad"),
    (r"\bmet(er|re)s?\b", "m"),
    (r"\bmilli(?=sec)", "m"),
    (r"\bmicro(?=sec)", "u"),
    (r"\bnano(?=sec)", "n"),
    (r"\b([mun]?)sec(ond)?s?\b", r"\1s"),
    (r"\bminutes?\b", "min"),
    (r"\bknots?\b|\bkts?\b", "kn"),
    (r"\bmps\b", "m/s"),
    (r"\bRPM\b|\b[rU]/min\b|\brev/min\b", "rpm"),
    (r"\brps\b|\br/s\b", "rev/s"),
    (r"\bHz\b", "1/s"),
    (r"\bNm\b", "N m"),
    (r"\bkNm\b", "kN m"),
    (r"\bPWM\b", "pwm"),
    (r"^([a-z]+) ?/ ?s ?/ ?s$|^([a-z]+)/s(?:\^)?2$", r"\1\2/s^2"),
    (r"^([A-Za-z]+) s\^?-1$", r"\1/s"),
    (r"^([A-Za-z]+) s\^?-2$", r"\1/s^2"),
    (r"^s\^?-1$", "1/s"),
    (r"\s*/\s*", "/"),
    (r"\s+", " "),
)
"""Pattern -> spelling in :data:`_TO_SI`, applied in this order: ``N*m``, ``rad s^-1`` (ROS), ``m/s²``, ``RPM``."""
_REVOLUTIONS = ("1/s", "1/min")
"""Units that mean revolutions for a propeller (ITTC writes n in 1/s), but radians for an angular velocity."""

OVERFULL = 1.5
"""Largest accepted normalised output. An output mixed from several actuators can slightly exceed 1. Project choice."""


@dataclass(frozen=True, slots=True)
class Dof:
    """One degree of freedom and the names of its signals and parameters.

    The letter of ``velocity`` appears in the parameter names: ``alpha_r``, ``beta_r``, ``beta_rr`` for yaw. If it is
    ``along_ground``, the position is a coordinate of the track, usually north or east. It is the integral of the
    velocity only after the heading is accounted for. If it is ``restored``, weight and buoyancy pull the craft back to
    level.
    """

    name: str
    velocity: str
    position: str
    force: str
    angular: bool
    along_ground: bool = False
    restored: bool = False

    @property
    def position_unit(self) -> str:
        """Unit of the position: ``rad`` or ``m``."""
        return "rad" if self.angular else "m"

    def parameter_names(self) -> tuple[str, str, str, str]:
        """Return the names of inertia, linear drag, quadratic drag and constant force."""
        nu = self.velocity
        return (f"alpha_{nu}", f"beta_{nu}", f"beta_{nu}{nu}", "delta")

    def derivative_names(self) -> tuple[str, str, str, str, str]:
        """Return the names of the derivatives that correspond to :meth:`parameter_names`, and of the delay."""
        force, nu = self.force, self.velocity
        return (f"{force}_{nu}dot", f"{force}_{nu}", f"{force}_{nu}{nu}", f"{force}_0", "delay")

    @property
    def restoring_name(self) -> str:
        """Name of the restoring moment per angle near level in results, positive if it pulls the craft back:
        ``gamma_phi``.
        """
        return f"gamma_{self.position}"

    @property
    def restoring_derivative(self) -> str:
        """Name of the derivative that corresponds to :attr:`restoring_name`: ``K_sinphi = -gamma_phi``."""
        return f"{self.force}_sin{self.position}"

    def restoring_unit(self, force_unit: str) -> str:
        """Return the unit of :attr:`restoring_name` for the unit of the input (``N m``, ``1``)."""
        return f"{force_unit}/{self.position_unit}"

    def parameter_units(self, force_unit: str) -> tuple[str, str, str, str]:
        """Return the units of :meth:`parameter_names` for the unit of the input (``N``, ``N m``, ``rad``, ``1``).

        Radians are written out, as in Miskovic2010, because with normalised inputs they would otherwise not appear.
        """
        length = self.position_unit
        base = "" if force_unit == "1" else force_unit + " "
        return (f"{base}s^2/{length}", f"{base}s/{length}", f"{base}s^2/{length}^2", force_unit)


DOFS: dict[str, Dof] = {
    d.name: d
    for d in (
        Dof("yaw", "r", "psi", "N", True),
        Dof("surge", "u", "x", "X", False, along_ground=True),
        Dof("sway", "v", "y", "Y", False, along_ground=True),
        Dof("heave", "w", "z", "Z", False),
        Dof("roll", "p", "phi", "K", True, restored=True),
        Dof("pitch", "q", "theta", "M", True, restored=True),
    )
}
"""Name -> degree of freedom."""

_FORCES = frozenset(d.force for d in DOFS.values())
_READ_BY_PREFIX = frozenset({*SIGNALS, "force"})
"""Prefixes of further columns that are read: ``force_left``, ``delta_2``, ``u_ref``."""
INPUTS = _FORCES | {"delta"}
"""Names of the forces and inputs."""

_PULSES = ("pwm", "servo", "rc", "rudder", "throttle", "thruster", "motor", "esc", "force_")
"""Prefixes of names, in lower case, for which microseconds are a pulse length."""

_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
_BOXED = re.compile(r"^\s*\[[^\[\]]+\[[^\[\]]*\]\s*\]\s*$")
_ROUND = re.compile(r"^\s*(?P<name>[^\[\]()]+?)\s*\((?P<unit>[^\[\]()]+)\)\s*$")


def parse_header(header: str) -> tuple[str, str]:
    """Return name and unit of a heading: ``"psi[deg]"`` or ``"psi (deg)"`` becomes ``("psi", "deg")``. Without a
    bracket the unit is ``""``.

    Round brackets around text that is not a unit belong to the name.

    Raises
    ------
    BadFile
        The text does not have that form.
    """
    if _BOXED.match(header):
        header = header.strip()[1:-1]
    match = _ROUND.match(header)
    if match is None or _plain(match["unit"]) not in _TO_SI:
        match = _HEADER.match(header)
    if match is None:
        raise BadFile(f"column head {header!r} is not name[unit]. Write e.g. psi[deg]")
    return match["name"], (match["unit"] or "").strip()


def to_si(unit: str) -> tuple[str, float]:
    """Return ``(si_unit, factor)`` of *unit*, such that ``value * factor`` is in *si_unit*.

    Raises
    ------
    BadFile
        The unit is not known.
    """
    try:
        return _TO_SI[_plain(unit)]
    except KeyError:
        known = ", ".join(u for u in _TO_SI if u)
        raise BadFile(f"unit [{unit}] is unknown. Known units: {known}") from None


def _plain(unit: str) -> str:
    unit = unit.strip()
    if unit in _TO_SI:
        return unit
    for pattern, spelling in _SPELLINGS:
        unit = re.sub(pattern, spelling, unit)
    return unit.strip()


def wrap(angle: float) -> float:
    """Return an angle [rad] wrapped to (-pi, pi]."""
    return -((-angle + math.pi) % (2.0 * math.pi) - math.pi)


def column_unit(name: str, unit: str) -> tuple[str, float]:
    """Return ``(si_unit, factor)`` of a column's unit, as :func:`to_si`. For a pulse, ``us`` is not a time.

    A pulse is a column with one of ``_PULSES`` as prefix, or an input. A column without a unit has that of its signal;
    a force without one is a normalised output. ``1/s`` means radians for an angular velocity, revolutions for a
    propeller. A column that is not a signal keeps an unknown unit.

    Raises
    ------
    BadFile
        The unit of a signal is not known.
    """
    plain = _plain(unit)
    if not plain and name in SIGNALS and name not in _FORCES:
        return SIGNALS[name][0], 1.0
    if plain in ("us", "pwm") and (name.lower().startswith(_PULSES) or name in INPUTS):
        return "pwm", 1.0
    if plain in _REVOLUTIONS and not re.match(r"(n|rpm|rps|prop)(?![a-z])", name, re.IGNORECASE):
        si = "rad/s" if SIGNALS.get(name, ("", ""))[0] == "rad/s" else "1/s"
        return si, 1.0 if plain == "1/s" else 1.0 / 60.0
    try:
        return to_si(unit)
    except BadFile:
        if name in SIGNALS or name.partition("_")[0] in _READ_BY_PREFIX:
            raise
        return unit.strip(), 1.0


SIDES: dict[str, tuple[str, str]] = {
    "surge": ("ahead", "astern"),
    "sway": ("to starboard", "to port"),
    "heave": ("down", "up"),
    "roll": ("to starboard", "to port"),
    "pitch": ("bow up", "bow down"),
    "yaw": ("to starboard", "to port"),
}
"""Degree of freedom -> direction of a positive and of a negative force or motion, in words."""
