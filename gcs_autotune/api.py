"""The Python interface for notebooks: from records to models, causes and gains.

::

    from gcs_autotune.api import load_runs, fit, diagnose, design, plot

    found = fit(load_runs("zigzag.csv"), dof="yaw")   # shown as a table
    plot(found)                                       # or plot(found, ax)

SI units and radians, except for columns with another unit in their heads (``psi[deg]``). Nothing here connects to a
vehicle.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.errors import AutotuneError, BadFile, UsageError
from gcs_autotune.notebook import in_python
from gcs_autotune.trial import Channel, Trial, save_trial, trial_of_columns

if TYPE_CHECKING:
    from gcs_autotune.design import Proposal
    from gcs_autotune.diagnose import Diagnosis
    from gcs_autotune.effects import ExtendedModel
    from gcs_autotune.identify import Fit, Model, ModelFile, Validation, load_model, save_model
    from gcs_autotune.identify import simulated as simulate
    from gcs_autotune.models import Form
    from gcs_autotune.report import Comparison, plot

__all__ = [
    "Comparison",
    "Diagnosis",
    "Fit",
    "ModelFile",
    "Proposal",
    "Trial",
    "compare",
    "design",
    "diagnose",
    "example_run",
    "fit",
    "load_model",
    "load_runs",
    "open_study",
    "plot",
    "save_model",
    "save_trial",
    "simulate",
    "validate",
]

Runs = Any
"""Runs as trials, or any other source of :func:`load_runs`: a path, a DataFrame, a mapping of arrays, or a list."""

_ON_FIRST_USE = {
    "Comparison": ("report", "Comparison"),
    "Diagnosis": ("diagnose", "Diagnosis"),
    "Fit": ("identify", "Fit"),
    "ModelFile": ("identify", "ModelFile"),
    "Proposal": ("design", "Proposal"),
    "load_model": ("identify", "load_model"),
    "plot": ("report", "plot"),
    "save_model": ("identify", "save_model"),
    "simulate": ("identify", "simulated"),
}
"""Name here -> (package, name there). It is imported on first use, so that a notebook starts at once."""

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import and return a name of :data:`_ON_FIRST_USE`."""
        if name not in _ON_FIRST_USE:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        package, there = _ON_FIRST_USE[name]
        globals()[name] = found = getattr(import_module(f"gcs_autotune.{package}"), there)
        return found


Returned = TypeVar("Returned")
Given = ParamSpec("Given")


def _with_python_arguments(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Return *function* with errors that name Python arguments instead of options of a command."""

    @functools.wraps(function)
    def wrapped(*args: Given.args, **kwargs: Given.kwargs) -> Returned:
        try:
            return function(*args, **kwargs)
        except AutotuneError as error:
            error.args = tuple(in_python(each) if isinstance(each, str) else each for each in error.args)
            raise

    return wrapped


@_with_python_arguments
def open_study(folder: str | Path, *, arrow: bool = False) -> Any:
    """Return the results of `study run` in *folder* as a pandas DataFrame, one row per case.

    Parameters
    ----------
    folder : the results folder.
    arrow : return the pyarrow table as it is stored instead, with the results as maps.

    Raises
    ------
    BadFile
        The folder contains no study, or a part cannot be read. UsageError: pandas or pyarrow is missing.

    Examples
    --------
    >>> open_study("empty")
    Traceback (most recent call last):
        ...
    gcs_autotune.errors.BadFile: empty contains no study: study.json is missing. Give the results folder of `study run`
    """
    from gcs_autotune.study import open_study as opened

    return opened(folder, arrow=arrow)


@_with_python_arguments
def load_runs(
    source: Any,
    *,
    columns: Mapping[str, str] | None = None,
    name: str = "run",
    pick: Sequence[int] = (),
    system: int | None = None,
    parameters: Mapping[str, float] | None = None,
) -> list[Trial]:
    """Return the runs in *source*.

    Parameters
    ----------
    source : the path of a run directory, a log or a CSV file; or a table in memory with columns ``name[unit]``,
        one of them (or the index, or coordinate) the time: a pandas DataFrame, an xarray Dataset
        (units also by ``attrs["units"]``), a mapping of arrays, a structured numpy array; or a list of any of these.
    columns : name in the source -> ``channel[unit]``, e.g. ``{"heading": "psi[deg]"}``.
    name : name of a run from memory.
    pick, system, parameters : for a log: segment numbers, the vehicle's system id, its parameters.

    Raises
    ------
    BadFile, NotInformative
        The source cannot be read, or nothing can be identified from it. UsageError: a name in *columns* does not exist.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(3.0)
    >>> (run,) = load_runs({"t[s]": t, "psi[deg]": 90.0 * t, "N": t})
    >>> run["psi"].unit, run["psi"].values.round(3)
    ('rad', array([0.   , 1.571, 3.142]))
    """
    if isinstance(source, (str, Path)):
        from gcs_autotune.logs import load_runs as load_files

        return load_files(source, pick=pick, system=system, columns=columns, parameters=parameters)
    if isinstance(source, Trial):
        return [source]
    if isinstance(source, (list, tuple)):
        names = [name if len(source) == 1 else f"{name}-{i}" for i in range(1, len(source) + 1)]
        return [
            run
            for each, own in zip(source, names, strict=True)
            for run in load_runs(each, columns=columns, name=own, pick=pick, system=system, parameters=parameters)
        ]
    return [trial_of_columns(_table(source), name, columns)]


@_with_python_arguments
def fit(
    runs: Runs,
    structure: str | Form | Path | None = None,
    method: str = "output-error",
    *,
    dof: str | None = None,
    delay: Literal["auto"] | float = "auto",
    use: Sequence[str] | None = None,
    loss: Literal["linear", "soft_l1"] = "linear",
    effects: Sequence[str] = (),
    start: ExtendedModel | Mapping[str, float] | None = None,
    **options: Any,
) -> Fit[Model]:
    """Return a model identified from runs. Parameters and errors are those of :func:`gcs_autotune.identify.fit`.

    runs : trials, or any source of :func:`load_runs`, such as a DataFrame.

    ``print`` shows the result as text and a notebook shows it as a table; see :func:`simulate`, :func:`validate` and
    :func:`plot`. It has ``to_pandas()`` and ``doubts``.

    Examples
    --------
    >>> found = fit(example_run(), "linear", dof="yaw", delay=0.0)
    >>> p = found.parameters["beta_r"]
    >>> abs(p.value - 0.5) < 3 * p.std, p.unit
    (True, 's/rad')
    >>> from gcs_autotune.api import simulate
    >>> motion = simulate(found, {"N": ([0.0, 30.0], [0.1, 0.0])})
    >>> bool(abs(motion["r"].values[-1] - 0.1 / p.value) < 1e-3)
    True
    """
    from gcs_autotune.identify import fit as fit_runs

    return fit_runs(
        load_runs(runs),
        structure,
        method,
        dof=dof,
        delay=delay,
        use=use,
        loss=loss,
        effects=effects,
        start=start,
        **options,
    )


@_with_python_arguments
def validate(found: Fit[Model], runs: Runs) -> Validation:
    """Return how well *found* predicts *runs* to which it was not fitted. Only the initial states are fitted.

    Raises
    ------
    UsageError
        The model cannot be simulated on a run.
    NotInformative
        The simulation diverges on a run's input.

    Examples
    --------
    >>> found = fit(example_run(), "linear", dof="yaw", delay=0.0)
    >>> bool(validate(found, example_run(seed=2)).fit_percent > 95.0)
    True
    """
    from gcs_autotune.identify import validate as validate_model

    return validate_model(found.model, load_runs(runs))


@_with_python_arguments
def diagnose(
    runs: Runs,
    *,
    unseen: Runs = (),
    dof: str | None = None,
    use: Sequence[str] | None = None,
    model: ExtendedModel | ModelFile | Fit[Model] | None = None,
    simulations: Runs = (),
    effects: Sequence[str] | None = None,
    horizon: float | None = None,
    jobs: int = 1,
) -> Diagnosis:
    """Return what a simulation gets wrong, and the cause, by :func:`gcs_autotune.diagnose.diagnose`.

    model : the simulation to examine, also as a :class:`Fit` of other runs; default the plain model fitted to the
    runs. The other parameters and errors are those of :func:`gcs_autotune.diagnose.diagnose`.

    Examples
    --------
    >>> told = diagnose(example_run(), dof="yaw", effects=["quadratic-drag"])
    >>> told.verdict, told.causes
    ('no-effect', ())
    """
    from gcs_autotune.diagnose import diagnose as diagnose_runs
    from gcs_autotune.identify import Fit, extended_of

    question = extended_of(model) if isinstance(model, Fit) else model
    return diagnose_runs(
        load_runs(runs),
        unseen=load_runs(unseen),
        dof=dof,
        use=use,
        model=question,
        simulations=load_runs(simulations),
        effects=effects,
        horizon=horizon,
        jobs=jobs,
    )


@_with_python_arguments
def design(
    source: Fit[Model] | ModelFile,
    axis: str,
    present: Mapping[str, float] | Path | str,
    *,
    firmware: str = "ardurover",
    **spec: Any,
) -> Proposal:
    """Return gains for one loop of an autopilot from a model of the craft. Nothing is written to any vehicle.

    Parameters
    ----------
    source : a fit, or a loaded model file.
    axis : ``heading``, ``yaw``, ``depth`` or ``speed``, if *firmware* (``ardurover``, ``ardusub``) has it.
    present : the vehicle's parameters, or a file of NAME,VALUE lines: the gains of the loop, its limits and
        filters; firmware defaults replace missing ones.
    spec : the specification, see :class:`gcs_autotune.design.Spec`: ``speed`` [m/s] for a craft with a rudder,
        ``full_scale`` for a model whose input is not a normalised output, ``settling_time`` [s] ...

    Raises
    ------
    NoGainsMeetSpec
        No gains inside the documented ranges are acceptable.
    UsageError, UnknownName, ParameterMissing
        The model is of another degree of freedom; full scale or speed is missing; the axis is unknown; a gain of the
        axis is not in *present*.

    Examples
    --------
    >>> gains = dict.fromkeys(("ATC_STR_RAT_FF", "ATC_STR_RAT_P", "ATC_STR_RAT_I", "ATC_STR_RAT_D"), 0.1)
    >>> gains["ATC_STR_ANG_P"] = 2.0
    >>> proposal = design(fit(example_run(), "linear", dof="yaw"), "heading", gains, speed=1.5)
    >>> proposal.after.metrics.itae <= proposal.before.metrics.itae, proposal.margins.stable
    (True, True)
    """
    from gcs_autotune.design import Spec, design_from
    from gcs_autotune.design import design as design_plain
    from gcs_autotune.firmware import FIRMWARE
    from gcs_autotune.identify import Fit, extended_of, is_of_one_axis
    from gcs_autotune.mavlink import load_params
    from gcs_autotune.registry import lookup

    loop = lookup(lookup(FIRMWARE, firmware, "firmware").axes, axis, f"axis of {firmware}")
    given = load_params(Path(present)) if isinstance(present, (str, Path)) else present
    values = dict(given)
    wish = Spec(**spec)
    if is_of_one_axis(source) and not source.effects:
        return design_plain(source.model, source.craft_covariance, loop, values, wish)
    if isinstance(source, Fit):
        covariance, names = source.covariance, tuple(source.parameters)
        return design_from(extended_of(source), loop, values, wish, names=names, covariance=covariance)
    return design_from(
        source.model, loop, values, wish, inputs=source.inputs, names=source.names, covariance=source.covariance
    )


@_with_python_arguments
def compare(sources: Sequence[Path | str], *, parameters: Mapping[str, float] | None = None) -> Comparison:
    """Return several run directories or logs of one craft side by side, and what changed.

    ``print`` shows it as text and a notebook shows it as tables.

    Raises
    ------
    UsageError
        There are fewer than two sources, more than twelve, or one twice.
    BadFile
        A source cannot be read.
    NotInformative
        The runs have no loop and no model in common.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     for seed in (1, 2):
    ...         save_trial(example_run(seed), Path(folder) / f"{seed}.csv")
    ...     compare([f"{folder}/1.csv", f"{folder}/2.csv"]).changed
    False
    """
    from gcs_autotune.workflow import compare as compare_runs

    return compare_runs([Path(source) for source in sources], parameters=parameters)


def example_run(seed: int = 1, duration: float = 60.0) -> Trial:
    """Return a synthetic example record: a relay experiment in heading, *duration* [s] at 10 Hz.

    True model: ``r_dot = N - 0.5 r`` with normalised input; noise 0.1 deg and 0.1 deg/s from *seed*.

    Examples
    --------
    >>> run = example_run()
    >>> sorted(run.channels), round(run.duration, 1)
    (['N', 'psi', 'r'], 59.9)
    """
    from gcs_autotune.models import SingleDof
    from gcs_autotune.models import simulate as simulate_model

    step = 0.1
    t: NDArray[np.float64] = step * np.arange(round(duration / step), dtype=np.float64)
    switches = np.sign(np.sin(2.0 * math.pi * t / 7.0) + 1e-9)
    force = 0.1 * switches
    truth = simulate_model(SingleDof("yaw", "1", 1.0, 0.5), t, force, t)
    noise = np.random.default_rng(seed).normal(0.0, math.radians(0.1), (2, len(t)))
    channels = {
        "N": Channel("N", "1", t, force),
        "psi": Channel("psi", "rad", t, truth.eta + noise[0]),
        "r": Channel("r", "rad/s", t, truth.nu + noise[1]),
    }
    return Trial("example", channels, meta={"source": "made up"})


def _table(source: Any) -> dict[str, ArrayLike]:
    """Return a table in memory as head -> array (n,)."""
    if hasattr(source, "data_vars"):
        return _of_xarray(source)
    if hasattr(source, "columns") and hasattr(source, "index"):
        found = {str(head): source[head].to_numpy() for head in source.columns}
        return _with_time(found, str(source.index.name or ""), source.index.to_numpy())
    if isinstance(source, np.ndarray) and source.dtype.names:
        return {head: _seconds(source[head]) for head in source.dtype.names}
    if isinstance(source, Mapping):
        return {str(head): _seconds(np.asarray(values)) for head, values in source.items()}
    raise UsageError(
        f"a {type(source).__name__} is not a source of runs. Use a path, a pandas DataFrame, an xarray Dataset, a "
        "mapping of name[unit] to arrays, or a structured array"
    )


def _of_xarray(source: Any) -> dict[str, ArrayLike]:
    """Return the variables of an xarray Dataset along its one dimension."""
    if len(source.sizes) != 1:
        raise BadFile(f"the Dataset must have one dimension (time). It has {', '.join(map(str, source.sizes))}")
    (along,) = source.sizes
    found: dict[str, ArrayLike] = {_head(n, v): v.to_numpy() for n, v in source.data_vars.items()}
    time = source.coords.get(along, None)
    return found if time is None else _with_time(found, _head(along, time), time.to_numpy())


def _head(name: object, variable: Any) -> str:
    unit = str(variable.attrs.get("units", ""))
    return f"{name}[{unit}]" if unit and "[" not in str(name) else str(name)


def _with_time(found: Mapping[str, ArrayLike], head: str, index: NDArray[Any]) -> dict[str, ArrayLike]:
    """Return the columns, including the index if it is the time."""
    columns: dict[str, ArrayLike] = {name: _seconds(np.asarray(values)) for name, values in found.items()}
    dated = index.dtype.kind in "mM"
    if dated or head.partition("[")[0] in ("t", "time"):
        return {"t[s]" if dated else head: _seconds(index), **columns}
    return columns


def _seconds(values: NDArray[Any]) -> NDArray[Any]:
    """Return dates and time differences as seconds since the first, other values unchanged."""
    if values.dtype.kind == "M":
        values = values - values[0]
    return values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values
