"""Propellers, their motors, and rudders of a vehicle file, as rows of the kernel.

``[thrusters]`` holds where each thruster is and which way it pushes, and its law of thrust. ``[propeller]`` with a
diameter replaces the law by K_T and K_Q over the advance number. ``[motor]`` gives the shafts a lag or a DC motor.
``[rudder]`` adds rudders. A part without a heading is off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from sitl.plants.kernel import MOTOR, PROPELLER, RUDDER
from sitl.plants.rigid_body import Array

__all__ = ["propeller_rows", "rudder_rows", "static_thrust", "thruster_count"]

Values = Mapping[str, Any]
_NO_MOTOR, _LAG, _DC = 0.0, 1.0, 2.0
_LAW = ("a_ahead", "b_ahead", "advance_ahead", "a_astern", "b_astern", "advance_astern", "torque", "torque_advance")
_HALVINGS = 80
"""Halvings of the interval in the search for a steady speed: to the last digit of a double."""


def thruster_count(thrusters: Values, heading: str = "thrusters") -> int:
    """Return the number of thrusters or rudders, which is the length of each list of the *heading*.

    Raises
    ------
    ValueError
        The lists are not of one length.
    """
    counts = {name: len(value) for name, value in thrusters.items() if isinstance(value, list)}
    if len(set(counts.values())) > 1:
        raise ValueError(f"{heading}: lists of different length ({', '.join(f'{n} {c}' for n, c in counts.items())})")
    return next(iter(counts.values()), 1)


def propeller_rows(thrusters: Values, propeller: Values, motor: Values) -> Array:
    """Return the propellers (p, PROPELLER) of a file's headings, of which those that are absent are empty.

    Raises
    ------
    ValueError
        Lists of different length, or a motor that is neither a lag nor a complete DC motor.
    """
    count = thruster_count(thrusters)
    rows = np.zeros((count, PROPELLER))

    def each(name: str, default: float) -> Array:
        return np.broadcast_to(np.asarray(thrusters.get(name, default), dtype=np.float64), count)

    azimuth, dip = each("azimuth", 0.0), each("dip", 0.0)
    rows[:, 0:3] = np.column_stack([each(name, 0.0) for name in "xyz"])
    rows[:, 3:6] = np.column_stack([np.cos(azimuth) * np.cos(dip), np.sin(azimuth) * np.cos(dip), np.sin(dip)])
    law = {name: each(name, 0.0) for name in _LAW}
    if "diameter" in propeller:
        D, rho = propeller["diameter"], propeller["density"]
        law["a_ahead"] = np.full(count, rho * D**4 * propeller["K_T0"])
        law["advance_ahead"] = np.full(count, -rho * D**3 * propeller.get("K_TJ", 0.0))
        law["torque"] = np.full(count, rho * D**5 * propeller.get("K_Q0", 0.0))
        law["torque_advance"] = np.full(count, -rho * D**4 * propeller.get("K_QJ", 0.0))
        for name in ("a", "advance"):
            law[f"{name}_astern"] = propeller.get("astern", 1.0) * law[f"{name}_ahead"]
    for name, ahead in (("a", "a_ahead"), ("b", "b_ahead"), ("advance", "advance_ahead")):
        if f"{name}_astern" not in thrusters and "diameter" not in propeller:
            law[f"{name}_astern"] = law[ahead]
    rows[:, 6:14] = np.column_stack([law[name] for name in _LAW])
    rows[:, 14], rows[:, 15], rows[:, 16] = each("hand", 1.0), each("wake", 0.0), each("full_n", 1.0)
    if "time_constant" in motor:
        rows[:, MOTOR], rows[:, MOTOR + 1] = _LAG, motor["time_constant"]
    elif motor:
        lacking = [name for name in ("inertia", "constant", "resistance", "voltage") if name not in motor]
        if lacking:
            raise ValueError(f"motor: missing entry '{lacking[0]}'. A motor has a time_constant, or all of a DC motor")
        rows[:, MOTOR] = _DC
        rows[:, MOTOR + 1 :] = (
            *(motor[name] for name in ("inertia", "constant", "resistance", "voltage")),
            motor.get("friction", 0.0),
            motor.get("most_current", math.inf),
        )
    return rows


def rudder_rows(rudder: Values, propellers: int) -> Array:
    """Return the rudders (r, RUDDER) of the file's heading; the first is behind the first propeller, and so on.

    Raises
    ------
    ValueError
        Lists of different length.
    """
    count = thruster_count(rudder, "rudder")
    rows = np.zeros((count, RUDDER))
    rows[:, 0], rows[:, 1] = rudder["x"], rudder.get("y", 0.0)
    rows[:, 3], rows[:, 4], rows[:, 5] = rudder["coefficient"], rudder["stall"], rudder.get("C_T", 0.0)
    rows[:, 6] = rudder.get("wake", 0.0)
    rows[:, 7] = [k if k < propellers else -1.0 for k in range(count)]
    rows[:, 8] = rudder.get("flow", 1.0)
    return rows


def static_thrust(row: Array, command: float) -> tuple[float, float]:
    """Return the steady thrust [N] and speed [1/s] of a propeller at rest in the water, at a normalised *command*."""
    n = command * row[16]
    if row[MOTOR] == _DC:
        _, constant, resistance, voltage, friction, most = row[MOTOR + 1 :]
        volts, low = min(abs(command), 1.0) * voltage, 0.0
        high = volts / (2.0 * math.pi * constant)
        for _ in range(_HALVINGS):
            n = 0.5 * (low + high)
            current = min(most, (volts - constant * 2.0 * math.pi * n) / resistance)
            if constant * current > row[12] * n * n + friction * 2.0 * math.pi * n:
                low = n
            else:
                high = n
        n = math.copysign(n, command)
    way = row[6:9] if n >= 0.0 else row[9:12]
    return float((way[0] * abs(n) + way[1]) * n), float(n)
