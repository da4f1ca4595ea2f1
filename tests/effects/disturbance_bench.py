"""Runs of craft under disturbances, by SciPy from equations written here, and the data that the effects receive."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from gcs_autotune.effects import DataSummary, EffectInstance, ExtendedSimulator, Passage, passage_of
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel

T_IN = np.arange(0.0, 40.0, 2.0)
T_OUT = np.arange(0.0, 40.0, 0.2)

State = Mapping[str, float]
Forces = Callable[[float, State, Mapping[str, float]], Mapping[str, float]]
"""Time, state and inputs to additional forces (X, Y, Z, N) in SI."""


@dataclass(frozen=True)
class Water:
    """What acts in addition to the plain craft."""

    forces: Forces = lambda t, s, held: {}
    V: tuple[float, float] = (0.0, 0.0)
    seen: bool = True
    payload: Callable[[float], float] = lambda t: 1.0
    Y_rdot: float = 0.0
    jumps: tuple[float, ...] = ()


@dataclass(frozen=True)
class Craft:
    """A plain craft and the commands it is given; ``inertia`` and ``drag`` by velocity letter."""

    form: Form
    inertia: Mapping[str, float]
    drag: Mapping[str, float]
    commands: Mapping[str, np.ndarray]
    start: Mapping[str, float]
    measured: tuple[str, ...]
    recorded: Mapping[str, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)
    """Channels that are in the file without being simulated."""

    def values(self) -> dict[str, float]:
        """Return the derivatives."""
        letters = dict(zip("uvwr", "XYZN", strict=True))
        inertia = {f"{letters[n]}_{n}dot": -v for n, v in self.inertia.items()}
        return {**inertia, **{f"{letters[n]}_{n}": -v for n, v in self.drag.items()}}

    def model(self) -> CoupledModel:
        return CoupledModel(self.form, self.values())

    def sail(self, water: Water) -> dict[str, np.ndarray]:
        """Return every signal at ``T_OUT``."""
        names = list(self.start)
        borders = np.unique(np.concatenate([T_IN, np.array(water.jumps), [T_OUT[-1]]]))
        x, found = np.array([self.start[n] for n in names]), [np.array([[self.start[n]] for n in names])]
        for a, b in itertools.pairwise(borders):
            held = {n: float(v[np.searchsorted(T_IN, 0.5 * (a + b)) - 1]) for n, v in self.commands.items()}
            at = T_OUT[(T_OUT > a + 1e-9) & (T_OUT <= b + 1e-9)]
            solved = solve_ivp(
                lambda t, s, h=held, m=0.5 * (a + b): self._rates(t, dict(zip(names, s, strict=True)), h, water, m),
                (a, b), x, method="DOP853", t_eval=np.unique([*np.minimum(at, b), b]), rtol=1e-9, atol=1e-10,
            )  # fmt: skip
            x = solved.y[:, -1]
            found.append(solved.y[:, : len(at)])
        signals = dict(zip(names, np.hstack(found), strict=True))
        if water.seen and {"u", "v", "psi"} <= set(signals):
            c, s = np.cos(signals["psi"]), np.sin(signals["psi"])
            signals["u"] = signals["u"] + water.V[0] * c + water.V[1] * s
            signals["v"] = signals["v"] + water.V[1] * c - water.V[0] * s
        return signals

    def _rates(
        self, t: float, s: dict[str, float], held: Mapping[str, float], water: Water, middle: float
    ) -> list[float]:
        more, k = water.forces(t, s, held), water.payload(middle)
        letters = {n: F for F, n in zip("XYZN", "uvwr", strict=True) if n in self.inertia}
        force = {n: held.get(F, 0.0) - self.drag[n] * s[n] + more.get(F, 0.0) for n, F in letters.items()}
        rate = {n: force[n] / (k * self.inertia[n]) for n in force}
        if water.Y_rdot:
            M = np.array([[self.inertia["v"], -water.Y_rdot], [-water.Y_rdot, self.inertia["r"]]])
            rate["v"], rate["r"] = np.linalg.solve(k * M, [force["v"], force["r"]])
        psi, u, v = s.get("psi", 0.0), s.get("u", 0.0), s.get("v", 0.0)
        c, n = np.cos(psi), np.sin(psi)
        rate["x"], rate["y"] = u * c - v * n + water.V[0], u * n + v * c + water.V[1]
        rate["z"], rate["psi"] = s.get("w", 0.0), s.get("r", 0.0)
        return [rate[name] for name in s]

    def channels(self, signals: Mapping[str, np.ndarray]) -> dict[str, Channel]:
        """Return the file's channels."""
        found = {n: Channel(n, SIGNALS[n][0], T_OUT, signals[n]) for n in self.measured}
        found |= {n: Channel(n, SIGNALS[n][0], T_IN, v) for n, v in self.commands.items()}
        return found | {n: Channel(n, SIGNALS[n][0], T_OUT, f(T_OUT)) for n, f in self.recorded.items()}

    def passage(self, signals: Mapping[str, np.ndarray]) -> Passage:
        return passage_of("run", T_IN, self.commands, dict.fromkeys(self.measured, T_OUT), self.channels(signals))

    def data_summary(self, signals: Mapping[str, np.ndarray]) -> DataSummary:
        channels = self.channels(signals)
        return DataSummary(
            form=self.form,
            inputs={n: SIGNALS[n][0] for n in self.commands},
            signals={n: SIGNALS[n][0] for n in self.measured},
            amplitude={n: float(np.abs(v).max()) for n, v in self.commands.items()},
            spread={n: float(np.std(signals[n])) for n in self.measured},
            level=dict.fromkeys(self.measured, 1e-3),
            channels=frozenset(channels),
            interval=0.2,
            time_constant=max((self.inertia[n] / self.drag[n] for n in self.drag if self.drag[n]), default=5.0),
            duration=float(T_OUT[-1]),
            extent={n: (float(c.values.min()), float(c.values.max())) for n, c in channels.items()},
            rms={n: float(np.sqrt(np.mean(c.values**2))) for n, c in channels.items()},
            base=self.values(),
            runs=("run",),
        )


def form(dofs: tuple[str, ...], values: Mapping[str, float], inputs: tuple[str, ...], **more: object) -> Form:
    driven = {n: (("N" if n == "delta" else n, 1.0),) for n in inputs}
    return Form("plain", "", dofs, tuple(values), {}, driven, coriolis=False, **more)  # type: ignore[arg-type]


def craft(
    dofs: tuple[str, ...],
    inertia: Mapping[str, float],
    drag: Mapping[str, float],
    commands: Mapping[str, np.ndarray],
    start: Mapping[str, float],
    measured: tuple[str, ...],
    recorded: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None,
) -> Craft:
    """Return a craft with its plain form."""
    blank = Craft(form(("yaw",), {}, ()), inertia, drag, commands, start, measured, recorded or {})
    plain = form(dofs, {n: v for n, v in blank.values().items() if v != 0.0}, tuple(commands))
    return Craft(plain, inertia, drag, commands, start, measured, recorded or {})


_rng = np.random.default_rng(4)


def levels(size: float) -> np.ndarray:
    """Return commands of random size, both ways."""
    return _rng.uniform(-size, size, len(T_IN))


BOAT = craft(
    ("surge", "sway", "yaw"), {"u": 20.0, "v": 30.0, "r": 5.0}, {"u": 8.0, "v": 25.0, "r": 4.0},
    {"X": 12.0 + levels(8.0), "Y": levels(9.0), "N": 1.0 + levels(3.0)},
    {"x": 1.0, "y": -2.0, "psi": 0.5, "u": 0.8, "v": 0.1, "r": 0.1}, ("x", "y", "psi", "u", "v", "r"),
)  # fmt: skip
SPINNER = craft(
    ("yaw",), {"r": 2.0}, {"r": 1.5}, {"N": 0.3 + levels(2.0)}, {"psi": 0.4, "r": 0.2}, ("psi", "r"),
)  # fmt: skip
DIVER = craft(
    ("heave",), {"w": 12.0}, {"w": 9.0}, {"Z": 2.0 * np.sign(np.sin(0.35 * T_IN + 0.5)) + levels(1.5)},
    {"z": 6.0, "w": 0.0}, ("z", "w"),
)  # fmt: skip
HOVERER = craft(
    ("yaw",), {"r": 2.0}, {"r": 1.5}, {"N": levels(2.0)}, {"psi": 0.4, "r": 0.2}, ("psi", "r"),
    {"z": lambda t: 8.0 - 1.5 * np.cos(0.25 * t)},
)  # fmt: skip
COASTER = craft(
    ("surge",), {"u": 15.0}, {"u": 6.0}, {"X": levels(10.0)}, {"x": 0.0, "u": 0.5}, ("x", "u")
)  # fmt: skip
SLIPPERY = craft(
    ("yaw",), {"r": 2.0}, {"r": 0.0}, {"N": levels(1.0)}, {"psi": 0.4, "r": 0.2}, ("psi", "r"),
)  # fmt: skip


class Fit:
    """Base parameters, initial states and effects fitted together to noisy signals by SciPy's least squares."""

    def __init__(
        self,
        craft: Craft,
        effects: tuple[EffectInstance, ...],
        noisy: Mapping[str, np.ndarray],
        levels: Mapping[str, float],
        bounds: Mapping[str, tuple[float, float]],
        base: np.ndarray | None = None,
    ) -> None:
        self.effects, self.noisy, self.levels = effects, noisy, levels
        plain = craft.form
        self.free = tuple((i, n) for i, own in enumerate(effects) for n in own.values)
        states = ExtendedSimulator(plain, effects).states
        self.simulator = ExtendedSimulator(plain, effects, plain.free, self.free, states)
        self.passage, self.p = craft.passage(noisy), len(plain.free)
        own = [effects[i].values[n] for i, n in self.free]
        first = craft.model().theta * 0.8 if base is None else base[: self.p]
        begin = [craft.start[n] for n in states] if base is None else base[self.p :]
        self.x = np.concatenate([first, own, begin])
        edges = [bounds.get(n, (-np.inf, np.inf)) for _, n in self.free]
        wide = [(-np.inf, np.inf)]
        plainly = [(-np.inf, -0.02 if n.endswith("dot") else 0.0) for n in plain.free]
        self.low, self.high = np.array(plainly + edges + wide * len(states), dtype=float).T

    def values(self) -> dict[str, float]:
        """Return the effects' parameters."""
        return dict(zip((n for _, n in self.free), self.x[self.p : self.p + len(self.free)].tolist(), strict=True))

    def residual(self, x: np.ndarray, *, jacobian: bool = False) -> np.ndarray:
        own = iter(x[self.p :].tolist())
        effects = tuple(e.with_values({n: next(own) for n in e.values}) for e in self.effects)
        x_0 = np.array(list(own))
        ran = self.simulator.run(x[: self.p], effects, x_0, self.passage, sensitivities=jacobian)
        if ran is None:
            return np.full(sum(len(y) for y in self.noisy.values()), 1e6)
        if jacobian:
            return np.vstack([ran[n][1] / self.levels[n] for n in self.noisy])
        return np.concatenate([(ran[n][0] - y) / self.levels[n] for n, y in self.noisy.items()])

    def promise(self) -> float:
        """Return the sum of squares that one Gauss-Newton step promises."""
        e, J = self.residual(self.x), self.residual(self.x, jacobian=True)
        if not J.ndim > 1:
            return np.inf
        left = e - J @ np.linalg.lstsq(J, e, rcond=1e-10)[0]
        return float(left @ left)

    def run(self) -> float:
        """Fit and return the sum of squares."""
        found = least_squares(
            self.residual, np.clip(self.x, self.low, self.high), lambda x: self.residual(x, jacobian=True),
            bounds=(self.low, self.high), x_scale="jac", max_nfev=40, ftol=1e-7,
        )  # fmt: skip
        self.x = found.x
        return 2.0 * float(found.cost)
