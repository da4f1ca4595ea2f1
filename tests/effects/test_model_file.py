"""Model files of every kind become one kind of model."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gcs_autotune.effects.effect import Applied
from gcs_autotune.effects.extended import ExtendedModel
from gcs_autotune.effects.model_file import as_coupled, load_model, model_from
from gcs_autotune.errors import BadFile, UnknownName
from gcs_autotune.models import SingleDof
from gcs_autotune.models.simulation import simulate

AXIS = SingleDof("yaw", "N m", alpha=2.0, beta=1.0, beta_quadratic=0.5, delta=0.1, delay=0.3)


def test_one_axis_moves_the_same_as_a_coupled_model():
    t = np.arange(0.0, 20.0, 0.1)
    tau = np.where(t % 8.0 < 4.0, 1.0, -0.7)
    ours = as_coupled(AXIS).simulate(t, {"N": tau}, t, {"psi": 0.2, "r": 0.1})
    theirs = simulate(AXIS, t, tau, t, 0.2, 0.1)
    assert np.max(np.abs(ours.values["psi"] - theirs.eta)) < 1e-4
    assert np.max(np.abs(ours.values["r"] - theirs.nu)) < 1e-4


def test_a_rudder_angle_drives_through_its_own_channel_and_fractions_have_no_newtons():
    assert list(as_coupled(SingleDof("yaw", "rad", 2.0, 1.0)).form.inputs) == ["delta"]
    assert as_coupled(SingleDof("heave", "1", 2.0, 1.0)).form.normalised


@pytest.mark.parametrize("wrapped", [None, "model", "extended_model"])
def test_documents_of_fits_and_diagnoses_are_opened(tmp_path, wrapped):
    model = ExtendedModel(as_coupled(AXIS), (Applied("dead-zone", "N", {"width": 0.3}),))
    data = model.to_dict() if wrapped is None else {wrapped: model.to_dict()}
    (tmp_path / "model.json").write_text(json.dumps(data))
    assert load_model(tmp_path / "model.json").to_dict() == model.to_dict()
    assert model_from(AXIS.to_dict(), "here").base.values["N_rdot"] == -2.0


def test_what_is_no_model_is_refused_by_name(tmp_path):
    with pytest.raises(BadFile, match=r"nowhere\.json"):
        load_model(tmp_path / "nowhere.json")
    for data in ({}, {"model": "thruster"}, {"model": "single-dof", "dof": "yaw"}, {"model": "coupled"}):
        with pytest.raises(BadFile, match="here"):
            model_from(data, "here")
    with pytest.raises(UnknownName, match="gremlins"):
        effects = [{"slug": "gremlins", "place": "N", "values": {}}]
        model_from({**ExtendedModel(as_coupled(AXIS)).to_dict(), "effects": effects}, "here")
