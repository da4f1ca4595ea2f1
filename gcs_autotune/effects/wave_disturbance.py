"""Wave disturbance: a force that swings in a narrow band of frequencies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import INPUT, Applied, Array, Curve, Effect, Family, Leftover, Quantity, Scene
from gcs_autotune.effects.narrow_band import Oscillator, whitened
from gcs_autotune.effects.wave_fit import NARROW, Band, band_of
from gcs_autotune.sname import DOFS

__all__ = ["WaveDisturbance"]


class WaveDisturbance(Effect):
    """A narrow-band force on one degree of freedom, of rms ``amplitude``, ``frequency``, damping ``bandwidth``.

    No simulation foretells its phase: it is learned from what is left over of the degree's position and velocity, and
    judged by predicting one sample ahead. Its force follows from the motion by the base model's inertia and drag
    (``Scene.base``); without them ``amplitude`` is not given.
    """

    slug: ClassVar[str] = "wave-disturbance"
    family: ClassVar[Family] = "environment"
    meaning: ClassVar[str] = "waves: a force that swings at one frequency, whatever the craft does"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("amplitude", INPUT, "rms of the force"),
        Quantity("frequency", "rad/s", "at which it swings, as met by the craft"),
        Quantity("bandwidth", "1", "damping ratio: 0 a pure tone, 0.2 an irregular sea"),
    )
    shown_by: ClassVar[str] = "one peak in the residual's spectrum, out of step with the commands"
    mistaken_for: ClassVar[tuple[str, ...]] = ("backlash", "measurement-delay", "tether-pull")
    separated_by: ClassVar[str] = "a few minutes with no command at all, on two headings: the swinging goes on"
    fixed: ClassVar[tuple[str, ...]] = ("amplitude", "frequency", "bandwidth")

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every degree of freedom of which something is measured."""
        return tuple(d for d in scene.form.dofs if {DOFS[d].position, DOFS[d].velocity} & set(scene.signals))

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """None yet; :meth:`learn` finds the band."""
        amplitude = {} if _gains(place, scene) is None else {"amplitude": 0.0}
        return ({**amplitude, "frequency": 6.0 / scene.pace, "bandwidth": 0.05},)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A period seen several times, and sampled."""
        amplitude = {} if _gains(place, scene) is None else {"amplitude": (0.0, 10.0 * max(scene.swing.values()))}
        return {**amplitude, "frequency": (0.0, math.pi / scene.interval), "bandwidth": (0.0, NARROW)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """Inertia and time constant of the base model, on the side of the input."""
        return _gains(place, scene) or {"lag": scene.pace}

    def learn(self, own: Applied, left: Sequence[Leftover]) -> Applied:
        """Find the band, if there is one."""
        dof, lag = DOFS[own.place], own.constants["lag"]
        mine = [x for x in left if x.signal in (dof.position, dof.velocity)]
        band = band_of(mine, velocity=dof.velocity, lag=lag)
        kept = {n: v for n, v in own.constants.items() if n in ("inertia", "lag")}
        if band is None:
            silent = {"amplitude": 0.0} if "inertia" in kept else {}
            return replace(own.with_values(silent), constants=kept)
        found = {"frequency": band.omega, "bandwidth": band.zeta}
        if "inertia" in kept:
            found["amplitude"] = _force(band, own)
        ratios = {f"ratio {s}": law.rho for s, law in band.laws.items()}
        # The lag as it was used: a time constant far from the period makes no difference and is not taken at its word.
        used = {"filter": next(iter(band.laws.values())).lag}
        errors = {f"std {n}": e for n, e in zip(("frequency", "bandwidth", "amplitude"), band.std, strict=True)}
        return replace(own.with_values(found), constants={**kept, **used, **ratios, **errors})

    def judge(self, own: Applied, left: Leftover, columns: Array) -> tuple[Array, Array, float]:
        """Return one-step prediction errors, at the size they have once the filter is settled."""
        rho = own.constants.get(f"ratio {left.signal}", 0.0)
        if rho <= 0.0 or len(left.error) == 0:
            return left.error, columns, 0.0
        rate = left.signal == DOFS[own.place].velocity
        law = Oscillator(own["frequency"], own["bandwidth"], own.constants["filter"], rate, rho)
        white, deviation = whitened(law, left.t, np.column_stack([left.error, columns]))
        settled = deviation[-1]
        white *= settled
        return white[:, 0], white[:, 1:], 2.0 * float(np.sum(np.log(deviation / settled)))

    def uncertainty(self, own: Applied, left: Sequence[Leftover]) -> Mapping[str, float]:
        """From the curvature of the likelihood; the amplitude's from how few independent swings there were."""
        if "std frequency" not in own.constants:
            return {}
        found = {n: own[n] * own.constants[f"std {n}"] for n in ("frequency", "bandwidth")}
        if "amplitude" in own.values:
            relative = math.hypot(own.constants["std amplitude"], own.constants["std frequency"])
            found["amplitude"] = own["amplitude"] * relative
        return found

    def curve(self, own: Applied, scene: Scene) -> Curve | None:
        """The spectrum of the force."""
        omega, zeta, a = own["frequency"], max(own["bandwidth"], 0.002), own.values.get("amplitude", 0.0)
        if a <= 0.0:
            return None
        x = np.linspace(0.0, 3.0 * omega, 901)
        y = a**2 * 4.0 * zeta * omega**3 / math.pi / ((omega**2 - x**2) ** 2 + (2.0 * zeta * omega * x) ** 2)
        unit = self.unit_of("amplitude", own.place, scene)
        return Curve(x, y, "frequency [rad/s]", f"force spectrum [({unit})^2 s/rad]", "Spectrum of the disturbance")

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """The force's, or that of the input when forces are known as fractions or angles."""
        if name != "amplitude":
            return next(q.unit for q in self.parameters if q.name == name)
        return scene.inputs.get(DOFS[place].force, next(iter(scene.inputs.values()), "1"))


def _gains(place: str, scene: Scene) -> dict[str, float] | None:
    """Return inertia and drag per unit of input, or None when the base model has no numbers yet."""
    dof, form = DOFS[place], scene.form
    known = {**form.known, **scene.base}
    body = {"yaw": "I_z", "roll": "I_x", "pitch": "I_y"}.get(place, "m")
    inertia = known.get(body, 0.0) - known.get(f"{dof.force}_{dof.velocity}dot", 0.0)
    if inertia == 0.0:
        return None
    gain = 1.0
    for pairs in form.inputs.values():
        for force, g in pairs:
            if force == dof.force and isinstance(g, str) and dof.force not in form.inputs:
                gain = known.get(g.lstrip("-"), 1.0)
    drag = -known.get(f"{dof.force}_{dof.velocity}", 0.0)
    return {"inertia": inertia / gain, "lag": inertia / drag if inertia * drag > 0.0 else 1e6}


def _force(band: Band, own: Applied) -> float:
    """Return the rms of the force [input] behind the motion."""
    dof = DOFS[own.place]
    signal = dof.velocity if dof.velocity in band.rms else dof.position
    law = band.laws[signal]
    if law.rate:
        speed = band.rms[signal] / math.sqrt(1.0 - law.share)
    else:
        speed = band.rms[signal] / math.sqrt(law.share) / law.lag
    return abs(own.constants["inertia"]) * band.omega * speed
