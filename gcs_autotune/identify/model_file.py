"""Model files: what ``diagnose`` and ``identify`` write, and ``identify --start``, ``tune --model`` and ``sitl`` read.

A model file contains the data of the model (key ``model``: ``extended``, ``coupled`` or ``single-dof``). Under
``known_from`` it contains the units of the inputs, the noise, and the parameters with their covariance. The JSON output
of ``identify`` and ``diagnose`` contains the same data and can be read too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.documents import conformed, load_json, model_file
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import BadFile
from gcs_autotune.identify.axis.form import PHYSICAL, SIGNS, as_extended
from gcs_autotune.identify.result import Fit, Model, Parameter
from gcs_autotune.models import CoupledModel, SingleDof
from gcs_autotune.notebook import Display, Displayed, parameter_tables
from gcs_autotune.plain_json import json_text
from gcs_autotune.sname import DOFS
from gcs_autotune_files import Refused
from gcs_autotune_files.model import KnownFrom, SingleDofData, model_data

__all__ = ["ModelFile", "load_model", "model_document", "model_file_of", "save_model"]

Array = NDArray[np.float64]

_SLIGHT = 1e-3
"""Tolerance for a correlation matrix that is not exactly symmetric or positive.

Rounding in the fit causes errors of 1e-6.
"""

KINDS = ("extended", "coupled", "single-dof")

INSIDE = ("model", "extended_model", "base_model")
"""Keys under which the JSON output of a command may contain a model. They are tried in this order."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelFile(Displayed):
    """A model read from a file, with its uncertainty.

    - ``model``: the model as a coupled model with effects, whatever the file contains.
    - ``axis``: the model of one degree of freedom if the file contains one, else None.
    - ``inputs``: name of the input -> unit.
    - ``noise``: name of the signal -> standard deviation of its noise.
    - ``names``, ``covariance`` (p, p): fitted parameters and their covariance, empty if the file does not contain them.
    """

    name: str
    model: ExtendedModel
    axis: SingleDof | None = None
    inputs: Mapping[str, str] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def written_as(self) -> Mapping[str, tuple[str, float]]:
        """Derivative -> its name in a file of one degree of freedom, and the sign between the two values.

        The mapping is empty for other files.
        """
        if self.axis is None:
            return {}
        dof = self.axis.axis
        words = dict(zip(dof.derivative_names(), zip(PHYSICAL, SIGNS, strict=True), strict=True))
        return words | ({dof.restoring_derivative: ("restoring", -1.0)} if dof.restored else {})

    def _display(self) -> Display:
        base, effects = self.model.base, self.model.effects
        values = {**base.values, **{own.label_of(name): value for own in effects for name, value in own.values.items()}}
        names = [*(n for n in self.names if n in values), *(n for n in values if n not in self.names)]
        covariance = np.zeros((len(names), len(names)))
        fitted = [i for i, n in enumerate(self.names) if n in values]  # they come first in *names*
        covariance[: len(fitted), : len(fitted)] = self.covariance[np.ix_(fitted, fitted)]
        std, inputs = np.sqrt(np.maximum(np.diag(covariance), 0.0)), self.inputs
        parameters = {
            name: Parameter(
                name,
                float(values[name]),
                base.form.unit_of(name, inputs) if name in base.values else "",
                float(s),
                "fitted" if s > 0.0 else "fixed",
            )
            for name, s in zip(names, std, strict=True)
        }
        listed = ", ".join(f"{name} [{unit}]" for name, unit in inputs.items())
        title = f"Model file '{self.name}': {base.form.title}{f'; inputs {listed}' if listed else ''}"
        return Display(title, tuple(t for t in parameter_tables(parameters, covariance) if t.rows))


def save_model(fit: Fit[Model], path: Path) -> None:
    """Write the model of *fit* to the model file *path*, with its noise and uncertainty.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from gcs_autotune.api import example_run, fit
    >>> with TemporaryDirectory() as folder:
    ...     save_model(fit(example_run(), "linear", dof="yaw"), Path(folder) / "craft.json")
    ...     load_model(Path(folder) / "craft.json").name
    'craft'
    """
    path.write_text(json_text(model_document(fit)), encoding="utf-8")


def model_document(fit: Fit[Model]) -> dict[str, Any]:
    """Return the contents of a model file of *fit*: the model with its effects, its noise and its uncertainty."""
    data = fit.to_dict()
    known = {k: data[k] for k in ("structure", "parameters", "correlation", "noise", "used")}
    return {**data["model"], "known_from": {**known, "inputs": data.get("inputs", {})}}


def load_model(path: Path) -> ModelFile:
    """Read a model file, the JSON output of an identification or a diagnosis, or the model of a run directory.

    Raises
    ------
    BadFile
        The file cannot be read or contains no model.
    UnknownName
        The model contains an unknown effect.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from gcs_autotune.api import example_run, fit
    >>> with TemporaryDirectory() as folder:
    ...     save_model(fit(example_run(), "linear", dof="yaw"), Path(folder) / "craft.json")
    ...     load_model(Path(folder) / "craft.json").inputs
    {'N': '1'}
    """
    file = model_file(path)
    model = _file(load_json(file, "a model file"), file)
    return model if file == path else replace(model, name=path.name)


def model_file_of(fit: Fit[Model]) -> ModelFile:
    """Return *fit* as a :class:`ModelFile` without writing it. The name of the file is that of the method."""
    return _file(model_document(fit), Path(fit.method))


def _file(data: Any, path: Path) -> ModelFile:
    inner, around = _model_in(data, path)
    model, axis = _built(inner, path)
    known = conformed(around, KnownFrom, path)
    names, covariance = _uncertainty(known, model.base.form.dofs, path)
    inputs = dict(model.units) or dict(known.inputs or {})
    if axis is not None:
        inputs = dict.fromkeys(model.base.form.inputs, axis.input_unit)
    noise = {name: value for name, value in (known.noise or {}).items() if value is not None}
    return ModelFile(path.stem, model, axis, inputs, noise, names, covariance)


def _model_in(data: Any, path: Path) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return the data of the model, and the data on its uncertainty."""
    if isinstance(data, dict):
        if data.get("model") in KINDS:
            return data, data.get("known_from") or {}
        for key in INSIDE:
            if isinstance(data.get(key), dict) and data[key].get("model") in KINDS:
                return data[key], data[key].get("known_from") or data
    raise BadFile(f"{path} contains no model. Create one with:  identify RUN --save FILE, or diagnose RUN --out DIR")


def _built(data: Mapping[str, Any], path: Path) -> tuple[ExtendedModel, SingleDof | None]:
    try:
        contents = model_data(data)
        if not isinstance(contents, SingleDofData):
            return ExtendedModel.of_data(contents), None
        axis = SingleDof.of_data(contents)
        model = as_extended(axis)
        CoupledModel.from_dict(model.base.to_dict())  # the same checks
    except (BadFile, Refused) as error:
        raise BadFile(f"{path}: {error}") from error
    return model, axis


def _uncertainty(known: KnownFrom, dofs: Sequence[str], path: Path) -> tuple[tuple[str, ...], Array]:
    """Return the names of the fitted parameters as derivatives, and their covariance (p, p)."""
    parameters, rows = known.parameters, known.correlation
    if parameters is None or rows is None:
        return (), np.zeros((0, 0))
    std = np.array([p.std or 0.0 for p in parameters.values()])
    if len(rows) != len(std) or any(len(row) != len(std) for row in rows):
        raise BadFile(
            f"{path}: its {len(std)} parameters need a correlation matrix of {len(std)} rows and columns. The "
            "file is damaged"
        )
    correlation = np.array([[value or 0.0 for value in row] for row in rows]).reshape(len(std), len(std))
    if not np.allclose(correlation, correlation.T, atol=_SLIGHT) or np.any(np.linalg.eigvalsh(correlation) < -_SLIGHT):
        raise BadFile(f"{path}: its correlation matrix is not symmetric and positive definite. The file is damaged")
    return _as_derivatives(tuple(parameters), correlation * np.outer(std, std), dofs)


def _as_derivatives(names: tuple[str, ...], covariance: Array, dofs: Sequence[str]) -> tuple[tuple[str, ...], Array]:
    """Return names and covariance in terms of derivatives.

    Names such as ``alpha_r`` become ``N_rdot``, with the opposite sign.
    """
    if len(dofs) != 1:
        return names, covariance
    dof = DOFS[dofs[0]]
    own = (*dof.parameter_names(), "delay")
    words = {a: (b, s) for a, b, s in zip(own, dof.derivative_names(), SIGNS, strict=True)}
    words[dof.restoring_name] = dof.restoring_derivative, -1.0
    signs = np.array([words.get(n, (n, 1.0))[1] for n in names])
    return tuple(words.get(n, (n, 1.0))[0] for n in names), np.outer(signs, signs) * covariance
