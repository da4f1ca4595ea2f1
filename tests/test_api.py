"""The notebook interface: records in; models, causes and gains out, each as a table or plot."""

from __future__ import annotations

import doctest
import inspect
import operator
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from gcs_autotune import api
from gcs_autotune.errors import BadFile, MissingChannel, NotInformative, UsageError
from gcs_autotune.identify import Doubt
from gcs_autotune.trial import Channel, Trial

RUN = api.example_run()
CLASSES = [n for n in api.__all__ if inspect.isclass(getattr(api, n))]
FUNCTIONS = [
    *(n for n in api.__all__ if inspect.isfunction(getattr(api, n))),
    *(f"{n}.{m}" for n in CLASSES for m, _ in inspect.getmembers(getattr(api, n), inspect.isfunction) if m[0] != "_"),
]
"""Public functions, and the methods of what they return."""


@pytest.fixture(scope="module")
def found() -> api.Fit:
    return api.fit(RUN, "linear", dof="yaw")


@pytest.mark.slow
@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_has_a_correct_example(name):
    if name.endswith("to_pandas"):
        pytest.importorskip("pandas")
    function = operator.attrgetter(name)(api)
    known = {**vars(api), **vars(sys.modules[function.__module__])}
    tests = doctest.DocTestFinder(recurse=False).find(function, name, globs=known)
    assert sum(len(t.examples) for t in tests) > 0
    for test in tests:
        assert doctest.DocTestRunner().run(test).failed == 0


def table() -> dict[str, np.ndarray]:
    t = np.arange(0.0, 2.0, 0.1)
    return {"t[s]": t, "psi[deg]": 10.0 * t, "N[N m]": np.sign(t - 1.0)}


def same_run(run: Trial) -> bool:
    (wanted,) = api.load_runs(table())
    return list(run.channels) == list(wanted.channels) and all(
        np.allclose(run[n].t, c.t) and np.allclose(run[n].values, c.values) and run[n].unit == c.unit
        for n, c in wanted.channels.items()
    )


def test_a_structured_array_and_a_list_of_mappings_are_runs():
    columns = table()
    array = np.rec.fromarrays(list(columns.values()), names=[*columns])
    assert same_run(api.load_runs(np.array(array))[0])
    runs = api.load_runs([table(), table()], name="lake")
    assert [run.name for run in runs] == ["lake-1", "lake-2"]
    assert same_run(runs[1])


def test_a_data_frame_with_time_as_column_index_or_date_is_a_run():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(table())
    assert same_run(api.load_runs(frame)[0])
    assert same_run(api.load_runs(frame.set_index("t[s]"))[0])
    dated = frame.set_index(pandas.Timestamp("2026-06-01 12:00") + pandas.to_timedelta(frame.pop("t[s]"), unit="s"))
    assert same_run(api.load_runs(dated)[0])


def test_a_dataset_with_unit_attributes_is_a_run():
    xarray = pytest.importorskip("xarray")
    columns = table()
    data = xarray.Dataset(
        {"psi": ("time", columns["psi[deg]"], {"units": "deg"}), "N": ("time", columns["N[N m]"], {"units": "N m"})},
        coords={"time": ("time", columns["t[s]"], {"units": "s"})},
    )
    assert same_run(api.load_runs(data)[0])
    with pytest.raises(BadFile, match="one dimension"):
        api.load_runs(data.expand_dims("boat"))


@pytest.mark.parametrize(
    ("source", "error", "words"),
    [
        ({"psi": [1.0]}, BadFile, "no time column"),
        ({"t[s]": [0.0, 1.0], "psi": [1.0]}, BadFile, "of equal length"),
        ({"t[s]": ["a"], "psi": ["b"]}, BadFile, "columns must be numbers"),
        ({"t[s]": [0.0], "psi[furlong]": [1.0]}, BadFile, "furlong"),
        ({"t[s]": [], "psi": []}, BadFile, "no samples"),
        (7, UsageError, "a int is not a source of runs"),
        ("/nowhere/at.csv", BadFile, "does not exist"),
    ],
)
def test_an_object_that_is_not_a_run_is_rejected(source, error, words):
    with pytest.raises(error, match=words):
        api.load_runs(source)


def test_a_simulation_with_the_inputs_of_the_run_matches_the_measurement(found):
    motion = api.simulate(found, RUN, stamps=RUN["psi"].t)
    assert np.std(motion["psi"].values - RUN["psi"].values) < 0.02 * np.std(RUN["psi"].values)
    again = api.simulate(found, {"N": (RUN["N"].t, RUN["N"].values)}, stamps=RUN["psi"].t, start={"psi": 0.5})
    assert again["psi"].values[0] == pytest.approx(0.5)


def test_inputs_that_do_not_fit_the_model_are_rejected(found):
    newtons = Trial("other", {"N": Channel("N", "N m", np.array([0.0]), np.array([1.0]))})
    with pytest.raises(UsageError, match="is in N m, but the model needs 1"):
        api.simulate(found, newtons)
    with pytest.raises(MissingChannel, match="no channel 'N'"):
        api.simulate(found, Trial("empty", {}))
    with pytest.raises(UsageError, match="needs the input N"):
        api.simulate(found, {"X": ([0.0], [1.0])})
    with pytest.raises(UsageError, match=r"do not match\. Supply at least one value"):
        api.simulate(found, {"N": ([0.0, 1.0], [1.0])})
    with pytest.raises(UsageError, match="no state depth"):
        api.simulate(found, RUN, start={"depth": 1.0})


def test_a_diverging_model_is_reported(found):
    from dataclasses import replace

    wild = replace(found, model=replace(found.model, beta=-5.0))
    with pytest.raises(NotInformative, match="diverges"):
        api.simulate(wild, {"N": ([0.0, 300.0], [1.0, 1.0])})


def test_a_fit_is_shown_as_a_table_with_escaped_text(found):
    from dataclasses import replace

    shown = replace(found, used=("<script>alert(1)</script>",))._repr_html_()
    assert "<script>" not in shown
    assert "&lt;script&gt;" in shown
    assert all(name in shown for name in found.parameters)


def test_a_fit_is_printed_with_residuals_correlations_and_doubts(found):
    from dataclasses import replace

    shown = str(replace(found, doubts=(Doubt("test", "nothing happened", "use --dof surge-yaw"),)))
    lines = shown.splitlines()
    assert all(any(line.split()[:1] == [name] for line in lines) for name in found.parameters)
    assert any(line.split()[0] == "psi" and line.endswith(" rad") for line in lines if line)
    assert "nothing happened. Cure: use dof= surge-yaw" in shown
    assert max(map(len, lines)) <= 88
    correlated = [line for line in lines if line.startswith("  beta_r, delta")]
    names = list(found.parameters)
    i, j = names.index("beta_r"), names.index("delta")
    assert bool(correlated) == (abs(found.correlation[i, j]) >= 0.5)


def test_every_result_prints_itself(found):
    assert "residual (rms)" in str(api.validate(found, RUN))
    assert str(api.diagnose(RUN, dof="yaw", effects=["quadratic-drag"])).startswith("no effect: ")
    gains = {f"ATC_STR_RAT_{term}": 0.1 for term in ("FF", "P", "I", "D")} | {"ATC_STR_ANG_P": 2.0}
    shown = str(api.design(found, "heading", gains, speed=1.5))
    assert "ATC_STR_ANG_P" in shown
    assert max(map(len, shown.splitlines())) <= 88


def test_a_data_frame_is_fitted_and_diagnosed_directly(found):
    pytest.importorskip("pandas")
    frame = RUN.to_pandas()
    direct = api.fit(frame, "linear", dof="yaw", delay=0.0)
    assert direct.parameters["beta_r"].value == pytest.approx(found.parameters["beta_r"].value)
    assert api.diagnose(frame, dof="yaw", effects=["quadratic-drag"]).verdict == "no-effect"
    assert api.validate(direct, frame).fit_percent > 90.0


def test_errors_in_python_name_arguments_instead_of_options():
    both = {"t[s]": RUN["psi"].t, **{n: c.values for n, c in RUN.channels.items()}}
    with pytest.raises(UsageError) as reported:
        api.fit({**both, "X": both["N"], "u": both["r"]})
    assert "Choose one with dof=" in str(reported.value)
    assert "--" not in str(reported.value)


def test_pandas_tables_contain_the_numbers_of_the_fit(found):
    pytest.importorskip("pandas")
    frame = found.to_pandas()
    p = found.parameters["beta_r"]
    assert frame.loc["beta_r", "value"] == p.value
    assert frame.loc["beta_r", "high"] - frame.loc["beta_r", "low"] == pytest.approx(2 * 1.96 * p.std)
    records = RUN.to_pandas()
    assert records["psi[rad]"].to_numpy() == pytest.approx(RUN["psi"].values)
    assert same_run(api.load_runs(api.load_runs(table())[0].to_pandas())[0])


def test_a_missing_pandas_is_reported_with_what_to_install(found, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match="pip install pandas"):
        found.to_pandas()


def test_a_fit_plots_on_supplied_axes(found):
    ax = Figure().subplots()
    assert api.plot(found, ax, signal="psi") is ax
    assert "heading" in ax.get_ylabel()
    assert isinstance(api.plot(found), Figure)
    with pytest.raises(UsageError, match="Available: psi of example"):
        api.plot(found, ax, signal="z")


@pytest.mark.slow
def test_gains_are_shown_and_plotted(found, tmp_path: Path):
    gains = {f"ATC_STR_RAT_{n}": 0.05 for n in ("FF", "P", "I", "D")} | {"ATC_STR_ANG_P": 1.0}
    proposal = api.design(found, "heading", gains, speed=1.5)
    assert proposal.changes
    shown = proposal._repr_html_()
    assert all(c.parameter in shown for c in proposal.changes)
    ax = Figure().subplots()
    assert api.plot(proposal, ax) is ax
    assert {line.get_label() for line in ax.lines} == {"set point", "wanted", "old gains", "new gains"}
    (tmp_path / "boat.param").write_text("".join(f"{n},{v}\n" for n, v in gains.items()))
    api.save_model(found, tmp_path / "model.json")
    again = api.design(api.load_model(tmp_path / "model.json"), "heading", tmp_path / "boat.param", speed=1.5)
    assert set(again.new) == set(proposal.new)
    if "pandas" in sys.modules:
        assert list(proposal.to_pandas()["new"]) == list(proposal.new.values())


@pytest.mark.slow
def test_a_diagnosis_shows_its_cause_and_accepts_a_fit_as_model(found):
    swing = api.simulate(found, {"N": (RUN["N"].t, 3.0 * RUN["N"].values)})
    noise = np.random.default_rng(2).normal(0.0, 2e-3, len(swing["r"]))
    bitten = Trial(
        "bitten",
        {**swing.channels, "r": Channel("r", "rad/s", swing["r"].t, swing["r"].values + noise)},
    )
    reported = api.diagnose(bitten, dof="yaw", model=found, effects=["quadratic-drag"])
    shown = reported._repr_html_()
    assert shown.startswith(f"<div><b>{reported.verdict}: bitten")
    ax = Figure().subplots()
    assert api.plot(reported, ax) is ax
    assert "measured minus simulated" in ax.get_ylabel()
    with pytest.raises(UsageError, match="no residual of w"):
        api.plot(reported, ax, signal="w")
