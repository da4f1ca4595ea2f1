"""A known mass in kg with inputs that are normalised outputs: used, or reported as not used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.identify import fit, scaled_form
from gcs_autotune.models import FORMS, form_from
from gcs_autotune.trial import Channel, Trial

SURGE = form_from(
    {"name": "surge", "dofs": ["surge"], "free": ["X_udot", "X_u"], "known": {"m": 5.0}, "inputs": {"X": {"X": 1}}},
    "a test",
)


def boat(unit: str = "1", full: float = 1.0) -> Trial:
    """Surge, sway and yaw without coupling: inertia over full output 2, 3 and 4 s, drag 1, 2 and 3."""
    t, rng = np.arange(0.0, 60.0, 0.1), np.random.default_rng(2)
    X, N = 0.5 + 0.3 * (t % 20.0 < 10.0), 0.4 * np.sign(np.sin(0.6 * t))
    u, v, r = (np.zeros(len(t)) for _ in range(3))
    for i in range(len(t) - 1):
        u[i + 1] = u[i] + 0.1 * (X[i] - u[i]) / 2.0
        v[i + 1] = v[i] + 0.1 * (-0.3 * u[i] * r[i] - 2.0 * v[i]) / 3.0
        r[i + 1] = r[i] + 0.1 * (N[i] - 3.0 * r[i]) / 4.0
    motion = {n: Channel(n, w, t, s + rng.normal(0.0, 0.002, len(t))) for n, w, s in
              (("u", "m/s", u), ("v", "m/s", v), ("r", "rad/s", r))}  # fmt: skip
    moment = unit if unit == "1" else "N m"
    return Trial("boat", {"X": Channel("X", unit, t, full * X), "N": Channel("N", moment, t, full * N), **motion})


def slugs(found: object) -> list[str]:
    return [d.slug for d in found.doubts]  # type: ignore[attr-defined]


def test_a_mass_that_normalised_outputs_cannot_use_is_reported() -> None:
    found = fit(boat(), FORMS["horizontal"].knowing({"m": 50.0}))
    (doubt,) = [d for d in found.doubts if d.slug == "mass-without-newtons"]
    assert doubt.cause.endswith("The known m = 50 was not used")
    assert "--full-scale X=...,N=..." in doubt.cure
    assert "m" not in found.model.values
    assert "mass-without-newtons" not in slugs(fit(boat(), FORMS["horizontal"]))


def test_a_mass_in_a_single_equation_of_normalised_outputs_is_reported() -> None:
    assert "mass-without-newtons" in slugs(fit(boat(), SURGE))
    assert "mass-without-newtons" not in slugs(fit(boat("N", 40.0), SURGE))
    assert "mass-without-newtons" not in slugs(fit(boat(), replace(SURGE, known={}, name="plain")))


def test_a_mass_that_forces_can_use_is_used() -> None:
    form, doubts = scaled_form(FORMS["horizontal"].knowing({"m": 50.0}), [boat("N", 40.0)])
    assert doubts == []
    assert form.known["m"] == 50.0
