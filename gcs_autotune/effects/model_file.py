"""Model files read as one kind of model, whoever wrote them: ``identify``, ``tune`` or ``diagnose``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gcs_autotune.effects.extended import ExtendedModel
from gcs_autotune.errors import BadFile, UnknownName
from gcs_autotune.models import SingleDof
from gcs_autotune.models.coupled import CoupledModel, Form

__all__ = ["as_coupled", "load_model", "model_from"]

_WRAPPED = ("extended_model", "model")
"""Where the documents of a diagnosis and of a fit keep their model."""


def load_model(path: Path) -> ExtendedModel:
    """Read a model file (JSON): an extended, a coupled or a single-axis model, or a fit's or diagnosis' document.

    Raises
    ------
    BadFile
        It cannot be read, or holds no model. UnknownName: an effect that is not in the book.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BadFile(f"{path}: not a model file: {error}") from error
    if not isinstance(data, Mapping):
        raise BadFile(f"{path}: not a model file: it holds no table of values")
    return model_from(data, str(path))


def model_from(data: Mapping[str, Any], origin: str) -> ExtendedModel:
    """Return the model in plain data; *origin* is named in messages.

    Raises
    ------
    BadFile
        There is none, or something of it is missing. UnknownName: an effect that is not in the book.
    """
    inside = next((data[key] for key in _WRAPPED if isinstance(data.get(key), Mapping)), data)
    kind = inside.get("model")
    try:
        if kind == "single-dof":
            return ExtendedModel(as_coupled(SingleDof.from_dict(inside)))
        if kind in ("coupled", "extended"):
            return ExtendedModel.from_dict(inside)
    except UnknownName:
        raise
    except (BadFile, KeyError, TypeError, ValueError) as error:
        raise BadFile(f"{origin}: not a whole model: {error!r}") from error
    raise BadFile(f"{origin}: no model in it; give the model.json of diagnose or tune, or what identify --json prints")


def as_coupled(model: SingleDof) -> CoupledModel:
    """Return a model of one degree of freedom in SNAME derivatives, with the same motion.

    ``alpha nu_dot + (beta + beta_nn |nu|) nu = tau + delta`` has ``N_rdot = -alpha``, ``N_r = -beta``,
    ``N_rr = -beta_nn``, ``N_0 = delta`` (thesis (6.33); SNAME 1950).
    """
    force, nu = model.axis.force, model.axis.velocity
    values = {f"{force}_{nu}dot": -model.alpha, f"{force}_{nu}": -model.beta}
    more = {f"{force}_{nu}{nu}": -model.beta_quadratic, f"{force}_0": model.delta, "delay": model.delay}
    values |= {name: value for name, value in more.items() if value != 0.0}
    channel = "delta" if model.input_unit == "rad" else force
    form = Form(
        name=f"{model.dof}-axis",
        title=f"{model.dof}, as identified",
        dofs=(model.dof,),
        free=tuple(values),
        known={},
        inputs={channel: ((force, 1.0),)},
        coriolis=False,
        normalised=model.input_unit == "1",
    )
    return CoupledModel(form, values)
