"""Export a model to Fossen's Python Vehicle Simulator (Fossen2021), as a vehicle class.

The class has the method ``dynamics(eta, nu, u_actual, u_control, h)``.
"""

from __future__ import annotations

from gcs_autotune.export.equations import MotionEquations

__all__ = ["to_fossen"]


def to_fossen(equations: MotionEquations) -> tuple[str, tuple[str, ...]]:
    """Return a Python file with the class; it needs NumPy only and contains all parts of the equations."""
    inputs = tuple(equations.inputs)
    rows = list(equations.rows)
    lines = "\n".join(f"        tau[{t.row}] += {t.text.replace('sin(', 'np.sin(').replace('cos(', 'np.cos(')}"
                      for t in equations.terms)  # fmt: skip
    coriolis = """        a, b = np.split(self.M @ nu_r, 2)
        tau[:3] -= np.cross(nu_r[3:], a)
        tau[3:] -= np.cross(nu_r[:3], a) + np.cross(nu_r[3:], b)
"""
    text = f'''"""{equations.name}, identified by gcs-autotune: a vehicle for the Python Vehicle Simulator.

SNAME axes, SI units, radians. Inputs: {", ".join(f"{c} [{u or '?'}]" for c, u in equations.inputs.items())}.
Not exported: {"; ".join(equations.left) or "nothing"}.
"""

import numpy as np


class {equations.identifier}:
    """The identified craft; `stepInput` commands a tenth of full output at its first input."""

    def __init__(self, controlSystem="stepInput", r=0, V_current=0, beta_current=0, tau_X=0):
        self.ref, self.V_c, self.beta_c, self.tauX = r, V_current, beta_current, tau_X
        self.controlMode = controlSystem
        self.controlDescription = "Step inputs"
        self.name = {equations.name!r}
        self.L = "unknown"
        self.controls = {[f"{c} ({u or '?'})" for c, u in equations.inputs.items()]!r}
        self.dimU = {len(inputs)}
        self.nu = np.zeros(6)
        self.u_actual = np.zeros({len(inputs)})
        self.M = np.array({equations.inertia.tolist()!r})
        self.rows = {rows!r}
        self.Minv = np.linalg.inv(self.M[np.ix_(self.rows, self.rows)])
        self.delay = {[equations.delay[c] for c in inputs]!r}  # s, of each input
        self.lag = {[equations.lag[c] for c in inputs]!r}  # s, first order
        self.t = 0.0
        self.commanded = []

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        """Return (nu, u_actual) a sampleTime later, by Euler's method."""
        u_actual = self._actuators(np.array(u_actual, float), u_control, sampleTime)
        nu_r = np.array(nu, float)
        nu_r[0] -= self.V_c * np.cos(self.beta_c - eta[5])
        nu_r[1] -= self.V_c * np.sin(self.beta_c - eta[5])
        u, v, w, p, q, r = nu_r
        x, y, z, phi, theta, psi = eta
        {", ".join(inputs)}{"," if len(inputs) == 1 else ""} = u_actual
        tau = np.zeros(6)
{lines}
{coriolis if equations.coriolis else ""}        nu_dot = np.zeros(6)
        nu_dot[self.rows] = self.Minv @ tau[self.rows]
        return np.array(nu, float) + sampleTime * nu_dot, u_actual

    def _actuators(self, u_actual, u_control, sampleTime):
        self.commanded.append((self.t, np.array(u_control, float)))
        for i in range(self.dimU):
            due = [u[i] for t, u in self.commanded if t <= self.t - self.delay[i] + 1e-9]
            wanted = due[-1] if due else 0.0
            if self.lag[i] > 0.0:
                u_actual[i] += min(sampleTime / self.lag[i], 1.0) * (wanted - u_actual[i])
            else:
                u_actual[i] = wanted
        self.commanded = [c for c in self.commanded if c[0] >= self.t - max(self.delay) - sampleTime]
        self.t += sampleTime
        return u_actual

    def stepInput(self, t):
        """Return a tenth of full output at the first input from 1 s on."""
        u_control = np.zeros({len(inputs)})
        u_control[0] = {0.1 * equations.full.get(inputs[0], 1.0)!r} if t >= 1.0 else 0.0
        return u_control
'''
    return text, ()
