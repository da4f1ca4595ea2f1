"""Export a model to Gazebo (gz-sim), as an element of the Hydrodynamics plugin.

The axes of the link are forward, left and up.

The coefficients of the plugin are SNAME's, negative for damping: ``xU`` times u, ``xUabsU`` times u |u|, ``xUV`` times
u v, ``xDotU`` the added mass. The change of axis from down to up changes the sign of v, w, q, r and of Y, Z, M, N.
"""

from __future__ import annotations

import re
from xml.sax.saxutils import escape

import numpy as np

from gcs_autotune.export.equations import ForceTerm, MotionEquations
from gcs_autotune.models import FORCES, STATES

__all__ = ["to_gazebo"]

SIGNS = (1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
_SIZE = re.compile(r"abs\((\w)\)")


def to_gazebo(equations: MotionEquations) -> tuple[str, tuple[str, ...]]:
    """Return the XML element of the plugin for a ``<model>``, and sentences about what the plugin cannot express."""
    found: dict[str, float] = {}
    left: list[str] = []
    added = equations.inertia - equations.rigid
    for i in range(6):
        for j in range(6):
            if added[i, j]:
                _add(found, f"{_force(i)}Dot{STATES[j].upper()}", -added[i, j] * SIGNS[i] * SIGNS[j])
    for term in equations.terms:
        if any(f.removeprefix("abs(").removesuffix(")") in equations.inputs for f in term.factors):
            continue  # Gazebo's thrusters push by themselves
        name, value = _named(term)
        if name:
            _add(found, name, value)
        else:
            left.append(equations.words_of(term))
    if np.any(np.diag(equations.inertia)) and not np.any(equations.rigid):
        left.append(
            "mass and inertia of the body itself. The model contains only their sum with the added mass, which is in "
            "the ...Dot... elements. Subtract the link's own values"
        )
    if "1" in equations.inputs.values():
        left.append(
            "the scale of the forces. The model has fractions of full output, and Gazebo reads N and N m. Multiply the "
            "numbers of each equation by its force at full output"
        )
    left += [f"the {what} of {c}, {s:.6g} s" for what, late in (("delay", equations.delay), ("lag", equations.lag))
             for c, s in late.items() if s]  # fmt: skip
    body = "\n".join(f"  <{name}>{value!r}</{name}>" for name, value in found.items())
    notes = escape("; ".join((*equations.left, *left))).replace("--", "- -")
    text = (
        f"<!-- {escape(equations.name)}, identified by gcs-autotune. Not exported: {notes or 'nothing'} -->\n"
        '<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">\n'
        f"  <link_name>base_link</link_name>\n{body}\n</plugin>\n"
    )
    return text, tuple(left)


def _force(row: int) -> str:
    return FORCES[row].lower()


def _add(found: dict[str, float], name: str, value: float) -> None:
    found[name] = found.get(name, 0.0) + float(value)


def _named(term: ForceTerm) -> tuple[str, float]:
    """Return the plugin's name for a term, and its coefficient; the name is empty if it has none."""
    plain = [f for f in term.factors if f in STATES]
    sizes = [m[1] for f in term.factors if (m := _SIZE.fullmatch(f)) and m[1] in STATES]
    if len(plain) + len(sizes) != len(term.factors) or (len(plain), len(sizes)) not in ((1, 0), (2, 0), (1, 1)):
        return "", 0.0
    sign = SIGNS[term.row] * np.prod([SIGNS[STATES.index(f)] for f in plain])
    name = _force(term.row) + plain[0].upper() + (f"abs{sizes[0].upper()}" if sizes else "")
    return name + "".join(f.upper() for f in plain[1:]), float(sign) * term.coefficient
