"""Format of model files, written by ``identify`` and ``diagnose``, and read by the tuner and the simulator.

Numbers are SI and radians; names of derivatives, channels and signals follow SNAME. What the numbers mean together
(is the inertia above 0?) is for whoever reads the file to judge.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from gcs_autotune_files import conform

__all__ = [
    "CoupledData",
    "Dof",
    "EffectData",
    "ExtendedData",
    "FormData",
    "KnownFrom",
    "ModelData",
    "Name",
    "Numbers",
    "Seconds",
    "SingleDofData",
    "model_data",
]

Dof = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
Name = Annotated[str, Meta(min_length=1, max_length=200)]
Numbers = dict[Name, float]
Seconds = Annotated[float, Meta(ge=0.0, le=3600.0)]
Schema = Literal[1]


class ParameterData(Struct, frozen=True):
    """A fitted parameter; ``std`` is its standard error."""

    unit: str
    std: Annotated[float, Meta(ge=0.0)] | None = None


class KnownFrom(Struct, frozen=True):
    """The data from which a model was identified; noise is a standard deviation per signal."""

    parameters: dict[Name, ParameterData] | None = None
    correlation: list[list[Annotated[float, Meta(ge=-1.001, le=1.001)] | None]] | None = None
    noise: dict[Name, Annotated[float, Meta(ge=0.0)] | None] | None = None
    inputs: dict[Name, str] | None = None


class FormData(Struct, forbid_unknown_fields=True, frozen=True):
    """The structure of a coupled model; a form file in TOML contains the same."""

    name: Name
    dofs: Annotated[list[Dof], Meta(min_length=1, max_length=6)]
    free: list[Name]
    title: str = ""
    known: Numbers = {}
    inputs: dict[Name, dict[Name, float | Name]] = {}
    coriolis: bool = True
    normalised: bool = False
    start: Numbers = {}
    optional: list[Name] = []
    per_inertia: list[Name] = []


class EffectData(Struct, forbid_unknown_fields=True, frozen=True):
    """An effect at a place, with its parameters."""

    slug: Name
    values: Numbers
    place: str = ""
    constants: Numbers = {}


class Constants(Struct, forbid_unknown_fields=True, frozen=True):
    """Size and unit of the inputs of the runs that a model was fitted to."""

    swing: Numbers = {}
    units: dict[Name, str] = {}


class SingleDofData(Struct, frozen=True, tag_field="model", tag="single-dof"):
    """``alpha nu_dot + (beta + beta_quadratic |nu|) nu + restoring eta = tau + delta``, the input *delay* [s] late."""

    dof: Dof
    input_unit: str
    alpha: float
    beta: float
    beta_quadratic: float
    delta: float
    delay: Seconds = 0.0
    restoring: float = 0.0
    schema: Schema = 1
    known_from: KnownFrom | None = None


class CoupledData(Struct, frozen=True, tag_field="model", tag="coupled"):
    """A form with a value for each of its parameters."""

    form: FormData
    values: Numbers
    schema: Schema = 1
    known_from: KnownFrom | None = None


class ExtendedData(Struct, frozen=True, tag_field="model", tag="extended"):
    """A coupled model with effects."""

    base: CoupledData
    effects: list[EffectData] = []
    constants: Constants = Constants()
    schema: Schema = 1
    known_from: KnownFrom | None = None


ModelData = SingleDofData | CoupledData | ExtendedData


def model_data(data: Any) -> ModelData:
    """Return plain data as a model of one of the three kinds.

    Raises
    ------
    gcs_autotune_files.Refused
        It is none.
    """
    return conform(data, ModelData)  # type: ignore[arg-type]
