"""Forms divided by their inertia hold accelerations, no forces; a mass cannot enter them."""

from __future__ import annotations

import pytest

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.models import FORMS, CoupledModel, form_from

TWIN = {"force_left": "N", "force_right": "N"}


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("X_udot", "N s^2/m"),
        ("X_u", "N s/m"),
        ("k_N", "rad/(N s^2)"),
        ("N_r", "1/s"),
        ("N_|u|r", "1/m"),
        ("N_u", "rad/(m s)"),
        ("N_0", "rad/s^2"),
        ("Y_v", "1/s"),
        ("Y_ur", "1/rad"),
        ("Y_r", "m/(rad s)"),
        ("I_z", "1"),
        ("Y_vdot", "1"),
        ("A_psi", "rad"),
    ],
)
def test_sway_and_yaw_of_two_thrusters_are_per_inertia_and_surge_is_in_newtons(name: str, unit: str) -> None:
    assert FORMS["twin-thruster"].unit_of(name, TWIN) == unit


def test_the_rudder_form_has_no_units_of_newtons() -> None:
    form = FORMS["rudder"]
    units = {n: form.unit_of(n, {"delta": "rad"}) for n in form.parameters}
    assert not any("N" in unit.split("/")[0].split() for unit in units.values()), units
    assert (units["X_uu"], units["N_delta"], units["I_z"]) == ("1/m", "1/s^2", "1")


@pytest.mark.parametrize("form", ["rudder", "twin-thruster"])
def test_a_mass_is_rejected_in_a_form_per_inertia(form: str) -> None:
    with pytest.raises(UsageError, match=r"m = 3272 cannot be used in form .* per unit of inertia"):
        FORMS[form].knowing({"m": 3272.0})
    assert FORMS[form].knowing({"delay": 0.2}).known["delay"] == 0.2


def test_a_mass_is_accepted_if_forces_are_known() -> None:
    assert FORMS["horizontal"].knowing({"m": 20.0}).known["m"] == 20.0


def test_per_inertia_survives_a_model_file_and_is_checked() -> None:
    form = FORMS["twin-thruster"]
    model = CoupledModel(form, dict.fromkeys(form.free, -1.0) | dict(form.known))
    assert CoupledModel.from_dict(model.to_dict()).form.per_inertia == ("Y", "N")
    with pytest.raises(BadFile, match="per_inertia contains Z"):
        form_from({"name": "odd", "dofs": ["yaw"], "free": ["N_r"], "per_inertia": ["Z"]}, "odd.toml")
