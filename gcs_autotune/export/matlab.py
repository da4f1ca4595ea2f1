"""Export a model to MATLAB (or Octave), as a function of the equations of motion for ode45."""

from __future__ import annotations

from gcs_autotune.export.equations import MotionEquations

__all__ = ["to_matlab"]


def to_matlab(equations: MotionEquations) -> tuple[str, tuple[str, ...]]:
    """Return a ``.m`` file; delays and lags are constants at its start, which the caller must apply."""
    inputs = tuple(equations.inputs)
    late = [
        f"the {what} of {c}, {s:.6g} s (a number in the file, to be applied to the input)"
        for what, table in (("delay", equations.delay), ("lag", equations.lag))
        for c, s in table.items()
        if s
    ]
    M = "\n".join(
        f"M({i + 1},{j + 1}) = {float(equations.inertia[i, j])!r};"
        for i in range(6)
        for j in range(6)
        if equations.inertia[i, j]
    )
    terms = "\n".join(f"tau({t.row + 1}) = tau({t.row + 1}) + {t.text};" for t in equations.terms)
    names = "\n".join(f"{c} = input({k + 1});  % [{u or '?'}]" for k, (c, u) in enumerate(equations.inputs.items()))
    coriolis = (
        "a = M(1:3,:) * nu;\nb = M(4:6,:) * nu;\n"
        "tau(1:3) = tau(1:3) - cross(nu(4:6), a);\n"
        "tau(4:6) = tau(4:6) - cross(nu(1:3), a) - cross(nu(4:6), b);\n"
    )
    rows = " ".join(str(r + 1) for r in equations.rows)
    text = f"""function dx = {equations.identifier}(~, state, input)
% {equations.name.upper()}  Equations of motion identified by gcs-autotune.
%   state = [x y z phi theta psi u v w p q r]', SNAME axes, SI units, radians;
%   input = [{" ".join(inputs)}]'.
%   delay [s]: {", ".join(f"{c} {equations.delay[c]:g}" for c in inputs)}; lag [s]: {
        ", ".join(f"{c} {equations.lag[c]:g}" for c in inputs)
    }; apply them to input.
%   Not exported: {"; ".join((*equations.left, *late)) or "nothing"}.
%
%   Example, a step of the first input:
%     [t, s] = ode45(@(t, s) {equations.identifier}(t, s, [{0.1 * equations.full.get(inputs[0], 1.0):g}; zeros({
        len(inputs) - 1
    }, 1)]), [0 30], zeros(12, 1));
%     plot(t, s(:, 7:12)); legend('u', 'v', 'w', 'p', 'q', 'r');
eta = state(1:6);
nu = state(7:12);
x = eta(1); y = eta(2); z = eta(3); phi = eta(4); theta = eta(5); psi = eta(6);
u = nu(1); v = nu(2); w = nu(3); p = nu(4); q = nu(5); r = nu(6);
{names}
M = zeros(6);
{M}
tau = zeros(6, 1);
{terms}
{coriolis if equations.coriolis else ""}rows = [{rows}];
nu_dot = zeros(6, 1);
nu_dot(rows) = M(rows, rows) \\ tau(rows);
Rz = [cos(psi), -sin(psi), 0; sin(psi), cos(psi), 0; 0, 0, 1];
Ry = [cos(theta), 0, sin(theta); 0, 1, 0; -sin(theta), 0, cos(theta)];
Rx = [1, 0, 0; 0, cos(phi), -sin(phi); 0, sin(phi), cos(phi)];
R = Rz * Ry * Rx;
T = [1, sin(phi)*tan(theta), cos(phi)*tan(theta);
     0, cos(phi), -sin(phi);
     0, sin(phi)/cos(theta), cos(phi)/cos(theta)];
dx = [R * nu(1:3); T * nu(4:6); nu_dot];
end
"""
    return text, tuple(late)
