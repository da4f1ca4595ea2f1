"""Forms: what remains of a coupled structure if forces are known only as normalised outputs."""

from __future__ import annotations

from gcs_autotune.models import FORMS


def test_each_normalised_equation_is_per_full_output_of_its_own_force() -> None:
    form = FORMS["horizontal"].in_shares
    assert form is not None and not form.coriolis and form.normalised and form.per_inertia == ("Y",)
    assert form.known == {"Y_vdot": -1.0, "N_vdot": 0.0}
    assert {"X_vr", "Y_ur", "N_uv"} <= set(form.free)
    units = {n: form.unit_of(n, {"X": "1", "N": "1"}) for n in form.parameters}
    assert units["X_udot"] == "s^2/m" and units["Y_v"] == "1/s" and units["N_uv"] == "s^2/m^2"
    assert not any("N" in unit for unit in units.values())


def test_a_form_with_forces_in_newtons_has_no_normalised_form() -> None:
    assert FORMS["horizontal"].fixing({"X_u": -4.0}).in_shares is None
    assert FORMS["6dof"].in_shares is None
    assert FORMS["horizontal"].fixing({"m": 11.0}).in_shares is not None  # a mass is left out: it is not a force
