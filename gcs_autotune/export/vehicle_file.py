"""Export a model as a vehicle file for this project's simulator.

The simulator runs with its own autopilot model, or as external physics of ArduPilot (--ardupilot-json). The hull is
that of the model. Sensors, link and parameters are those of a craft in the simulator's table: the BlueROV2 for a craft
that dives, the BlueBoat for a craft on the surface with two thrusters.
"""

from __future__ import annotations

from gcs_autotune.errors import UsageError
from gcs_autotune.export.equations import ForceTerm, MotionEquations
from gcs_autotune.models import FORCES

__all__ = ["to_vehicle_file"]

AXES = {"surge": (0, "u", "X"), "sway": (1, "v", "Y"), "heave": (2, "w", "Z"), "yaw": (5, "r", "N")}
"""Table of the vehicle file -> row of the equations, velocity and input."""
PLANE = ("u", "v", "r")


def to_vehicle_file(equations: MotionEquations) -> tuple[str, tuple[str, ...]]:
    """Return the TOML text of the vehicle file, and sentences about omitted elements of the model.

    Raises
    ------
    UsageError
        The simulated frames cannot be driven in this way, or full output of an input is unknown.
    """
    _see(equations)
    dives, left = 2 in equations.rows, []
    blocks = [
        f"# {equations.name}, identified by gcs-autotune.",
        f"title = {_quoted(equations.name)}",
        f'like = "{"bluerov2" if dives else "blueboat"}"',
    ]
    own: set[int] = set()
    for table, (row, velocity, _) in AXES.items():
        if row not in equations.rows:
            continue
        linear = _sum(equations, row, (velocity,), own)
        square = _sum(equations, row, (f"abs({velocity})", velocity), own)
        constant = _sum(equations, row, (), own)
        values = {"alpha": float(equations.inertia[row, row]), "beta": -linear, "beta2": -square}
        if table == "yaw" or (table == "heave" and dives):
            values["bias"] = constant
        elif constant:
            left.append(equations.words_of(ForceTerm(row, constant, ())))
        if dives and table in ("yaw", "surge", "heave"):
            values["authority"] = _authority(equations, row, own)
        blocks.append(_table(table, values))
    blocks += _thrusters(equations, own, dives=dives)
    if 1 in equations.rows:
        blocks.append(_coupling(equations, own, left))
    left += [equations.words_of(t) for k, t in enumerate(equations.terms) if k not in own]
    for slug, name, late in (
        ("input-delay", "delay", equations.delay),
        ("actuator-lag", "time_constant", equations.lag),
    ):
        left += [f"{slug} (start it with --effect {slug}@{c}.{name}={s:.6g})" for c, s in late.items() if s]
    return "\n".join(blocks) + "\n", tuple(left)


def _see(equations: MotionEquations) -> None:
    strange = [c for c in equations.inputs if c not in FORCES]
    if strange:
        raise UsageError(
            f"the model is driven by {', '.join(strange)}, but a vehicle file has thrusters. Simulate the model "
            "itself: gcs-autotune sitl charlie --model FILE --ardupilot-json"
        )
    unknown = [c for c in equations.inputs if c not in equations.full]
    if unknown:
        scales = ",".join(f"{c}=..." for c in unknown)
        raise UsageError(
            f"the full output of {', '.join(unknown)} is unknown. Supply it with --full-scale {scales} [N, N m]"
        )
    if any(row in equations.rows for row in (3, 4)):
        raise UsageError("roll and pitch, which the simulator does not model")


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _sum(equations: MotionEquations, row: int, factors: tuple[str, ...], own: set[int]) -> float:
    """Return the sum of the coefficients of all terms with these factors, and mark the terms as exported."""
    total = 0.0
    for k, term in enumerate(equations.terms):
        if term.row == row and tuple(sorted(term.factors)) == tuple(sorted(factors)):
            total += term.coefficient
            own.add(k)
    return total


def _authority(equations: MotionEquations, row: int, own: set[int]) -> float:
    """Return the force of the row's own input at full output; 0 if no input drives it."""
    channel = FORCES[row]
    return abs(_sum(equations, row, (channel,), own) * equations.full.get(channel, 0.0))


def _thrusters(equations: MotionEquations, own: set[int], *, dives: bool) -> list[str]:
    if dives:
        return ["[thruster]", _number("odd", [1.0]), _number("dead", 0.0)]
    ahead, turning = _authority(equations, 0, own), _authority(equations, 5, own)
    values = {"astern": 1.0}
    if ahead:
        values["full_thrust"] = 0.5 * ahead
    if turning:  # one full ahead and one full astern; the BlueBoat's thrusters give 55.2 N each
        values["arm"] = 0.5 * turning / (0.5 * ahead or 55.2)
    return [_table("thruster", values)]


def _coupling(equations: MotionEquations, own: set[int], left: list[str]) -> str:
    """Return the coupling terms of surge, sway and yaw."""
    values: dict[str, float] = {}
    for name, (i, j) in {"Y_rdot": (1, 5), "N_vdot": (5, 1)}.items():
        if equations.inertia[i, j]:
            values[name] = -float(equations.inertia[i, j])
    for k, term in enumerate(equations.terms):
        name = _derivative(term)
        if k not in own and name:
            values[name] = values.get(name, 0.0) + term.coefficient
            own.add(k)
    sideways = _authority(equations, 1, own)
    if sideways:
        left.append(f"the input Y ({sideways:.6g} at full output), because no simulated boat thrusts sideways")
    lines = [f'coriolis = {{ value = {str(equations.coriolis).lower()}, unit = "1", source = "identified" }}']
    return "\n".join(["[coupling]", *lines, *(_number(f'"{n}"', v) for n, v in values.items())])


def _derivative(term: ForceTerm) -> str:
    """Return the SNAME name of a product of u, v, r in X, Y or N; empty for any other product."""
    plain = [f.replace("abs(", "|").replace(")", "|") for f in term.factors]
    if term.row not in (0, 1, 5) or not plain or any(f.strip("|") not in PLANE for f in plain):
        return ""
    return f"{FORCES[term.row]}_{''.join(sorted(plain, reverse=True))}"


def _table(name: str, values: dict[str, float]) -> str:
    return "\n".join([f"[{name}]", *(_number(n, v) for n, v in values.items())])


def _number(name: str, value: object) -> str:
    return f'{name} = {{ value = {value!r}, unit = "SI", source = "identified" }}'
