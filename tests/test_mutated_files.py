"""A thousand damaged files of every kind that is read strictly: none ends in a traceback, no nonsense is accepted.

Logs and tables of samples have tests of their own.
"""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from referencing import Registry, Resource

from gcs_autotune.cli import read_config
from gcs_autotune.documents import SettingOut, conformed, load_json
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify import load_model
from gcs_autotune.identify.plan import load_plan
from gcs_autotune.link.parameters.journal import read_journal
from gcs_autotune.manoeuvres import read_area
from gcs_autotune.mavlink import load_params
from gcs_autotune.models import load_form
from gcs_autotune.trial import load_trial
from gcs_autotune.workflow import CommonSettings, Connection, load_flight_plan
from gcs_autotune_files import Refused, parse
from sitl import BadVehicle, load_vehicle
from sitl.modelfile import BadModel, read_model

EACH = 72
"""Mutants of each kind; there are 14 kinds."""
LONGEST = 900
"""Characters of a message: a path of pytest's has 200, the range and the reason of a limit 200."""

SINGLE = {
    "schema": 1, "model": "single-dof", "dof": "yaw", "input_unit": "1",
    "alpha": 1.5, "beta": 0.5, "beta_quadratic": 0.1, "delta": 0.01, "delay": 0.2,
    "known_from": {
        "parameters": {
            "alpha_r": {"value": 1.5, "unit": "s^2/rad", "std": 0.1},
            "beta_r": {"value": 0.5, "unit": "s/rad", "std": 0.1},
        },
        "correlation": [[1.0, 0.25], [0.25, 1.0]],
        "noise": {"psi": 0.01}, "inputs": {"N": "1"},
    },
}  # fmt: skip
COUPLED = {
    "schema": 1, "model": "coupled",
    "form": {
        "name": "plane", "title": "surge, sway and yaw", "dofs": ["surge", "sway", "yaw"],
        "free": ["X_udot", "Y_vdot", "N_rdot", "X_u", "Y_v", "N_r"], "known": {"m": 8.0},
        "inputs": {"X": {"X": 1.0}, "N": {"N": 1.0}}, "coriolis": True,
    },
    "values": {"X_udot": -4.0, "Y_vdot": -9.0, "N_rdot": -2.0, "X_u": -3.0, "Y_v": -5.0, "N_r": -1.0, "m": 8.0},
}  # fmt: skip
EXTENDED = {
    "schema": 1, "model": "extended", "base": COUPLED,
    "effects": [{"slug": "dead-zone", "place": "N", "values": {"width": 0.1}, "constants": {"swing": 2.0}}],
    "constants": {"swing": {"X": 10.0, "N": 2.0}, "units": {"X": "N", "N": "N m"}},
}  # fmt: skip
GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": {"name": "harbour"}, "geometry": {
            "type": "Polygon",
            "coordinates": [[[10.0, 59.0], [10.2, 59.0], [10.3, 59.1], [10.1, 59.2], [10.0, 59.0]]],
        }},
    ],
}  # fmt: skip
SIDE = {
    "schema": 1, "name": "relay-1", "ending": "completed", "reason": "five periods",
    "meta": {"manoeuvre": "relay", "signal": "psi"},
    "marks": [
        {"t": 0.1, "kind": "switch", "detail": {"x": 0.1}},
        {"t": 0.2, "kind": "target", "detail": {"value": 1.0}},
    ],
}  # fmt: skip
SET_OUT = {
    "settings": {"axis": "heading", "step": 0.5, "given": False},
    "vehicle": {"system": 1, "uid": "ab", "version": "4.6.3", "frame": None},
    "fingerprint": {"RC1_TRIM": 1500.0}, "parameters": {"ATC_STR_RAT_P": 0.2},
}  # fmt: skip
PARAMETERS = {"schema": 1, "comment": "before", "parameters": {"ATC_STR_RAT_P": 0.2, "CRUISE_SPEED": 1.5}}
JOURNAL = (
    {"event": "opened", "time": "t", "schema": 1, "vehicle": {"system": 1}, "link": "udp", "mode": "HOLD",
     "armed": False, "fingerprint": {"RC1_TRIM": 1500.0}},
    {"event": "lent", "time": "t", "name": "ATC_STR_RAT_P", "value": 0.2},
    {"event": "writing", "time": "t", "name": "ATC_STR_RAT_P", "value": 0.4},
    {"event": "written", "time": "t", "name": "ATC_STR_RAT_P", "value": 0.4},
    {"event": "kept", "time": "t", "values": {"ATC_STR_RAT_P": 0.4}},
    {"event": "closed", "time": "t"},
)  # fmt: skip
VEHICLE = (Path(__file__).parents[1] / "sitl" / "vehicles" / "blueboat.toml").read_text()
FORM = """name = "yaw"
dofs = ["yaw"]
free = ["N_rdot", "N_r"]
[known]
N_0 = 0.5
[inputs.N]
N = 1
"""
PLAN = """name = "two"
[known]
m = 11.0
[[step]]
name = "surge"
manoeuvre = "steps"
dofs = ["surge"]
isolated = ["X_u"]
shared = ["X_udot"]
held = ["m"]
validate = 1
delay = 0.25
[step.inputs.X]
X = 1
"""
FLIGHTS = """title = "two"
[conditions]
calm = true
min-depth = 0.5
[defaults]
throttle = 0.4
[[run]]
manoeuvre = "zig-zag"
heading = [10, 20]
executes = 3
repeat = 2
"""
CONFIG = """[link]
connect = "udpin:0.0.0.0:14550"
system-id = 7
[limits]
max-distance = 40
max-speed = 2.5
"""
LINES = "# saved\nATC_STR_RAT_P,0.2\nATC_STR_RAT_I 0.1\n1\t1\tCRUISE_SPEED\t1.5\t9\nRC1_TRIM,1500\n"


@dataclass(frozen=True)
class Kind:
    """A file as it should be, how it is read, and what in it is not looked at (``free``: places by their ends)."""

    name: str
    load: Callable[[Path], object]
    data: Any = None
    free: tuple[str, ...] = ()
    positive: tuple[str, ...] = ()
    schema: str = ""
    """Name of the published schema, for what is one document."""
    text: str = ""
    torn: str = "-"
    """Where damage is expected, as a power cut leaves it."""


def _flights(path: Path) -> object:
    common = CommonSettings(Connection("sitl:charlie"), path.parent / "run")
    return load_flight_plan(path, common, None, None)


def _trial(path: Path) -> object:
    path.with_suffix(".csv").write_text("t[s],psi[rad]\n0,0\n0.1,0.1\n")
    return load_trial(path.with_suffix(".csv"))


_KNOWN = ("known_from.parameters.alpha_r.value", "known_from.parameters.beta_r.value")
KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "single.json",
            load_model,
            SINGLE,
            free=_KNOWN,
            schema="model-file",
            positive=("alpha", "delay", "known_from.noise.psi"),
        ),
        Kind("coupled.json", load_model, COUPLED, schema="model-file", positive=("values.m",)),
        Kind("extended.json", load_model, EXTENDED, schema="model-file"),
        Kind("flown.json", read_model, EXTENDED, schema="model-file"),
        Kind("area.geojson", lambda path: read_area(str(path)), GEOJSON, free=("features.0.properties",)),
        Kind(
            "side.json",
            _trial,
            SIDE,
            free=("meta", "marks.0.detail", "marks.1.detail"),
            schema="trial-file",
            torn="schema",
        ),
        Kind("setting_out.json", lambda p: conformed(load_json(p, "it"), SettingOut, p), SET_OUT, free=("settings",)),
        Kind("parameters.json", load_params, PARAMETERS, free=("schema", "comment")),
        Kind("journal.jsonl", read_journal, JOURNAL, free=("time",), torn="5."),
        Kind("mine.toml", lambda path: load_vehicle(str(path)), text=VEHICLE),
        Kind("form.toml", load_form, text=FORM),
        Kind("plan.toml", load_plan, text=PLAN),
        Kind("flights.toml", _flights, text=FLIGHTS),
        Kind("gcs-autotune.toml", read_config, text=CONFIG),
        Kind("boat.param", load_params, text=LINES),
    )
}
REFUSALS = (AutotuneError, BadVehicle, BadModel)
DEEP = "[" * 3000
NEVER = (
    "NaN",
    "Infinity",
    "-Infinity",
    "1e999",
    "1" + "0" * 400,
    "9" * 5000,
    DEEP,
    '"\\ud800"',
    "1_0",
    "٣",
    "+1",
    "0x10",
)
"""What stands for no value in JSON, wherever it stands."""
WRONG = ('"text"', "true", "[]", "{}", '""', "[[1]]", '{"a": 1}')
"""What is no number, where a number should be."""
NEVER_TOML = ("nan", "inf", "-inf", "1e999", "9" * 400, "9" * 5000, "0x" + "f" * 400, DEEP, "٣", '"text"', "true", "{}")
NEVER_LINES = ("nan", "inf", "1_0", "٣", "0x10", "1e39", "text", "1.2.3", "--1", "9" * 5000, "")


REFERENCE = Path(__file__).parents[1] / "docs" / "reference"
DOCUMENTS = {path.name: json.loads(path.read_text()) for path in REFERENCE.glob("*.schema.json")}
REGISTRY: Any = Registry().with_resources((name, Resource.from_contents(text)) for name, text in DOCUMENTS.items())
SCHEMAS = {
    name: Draft202012Validator(DOCUMENTS[f"{name}.schema.json"], registry=REGISTRY)
    for name in ("model-file", "trial-file")
}


def places(data: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every leaf with where it is."""
    named = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, (list, tuple)) else None
    if named is None:
        yield at, data
        return
    for name, value in named:
        yield from places(value, f"{at}.{name}" if at else str(name))


def changed(data: Any, at: str, value: Any) -> Any:
    """Return a copy of *data* with another value at a place."""
    new = copy.deepcopy(data)
    steps = [int(s) if s.isdigit() else s for s in at.split(".")]
    here = new
    for step in steps[:-1]:
        here = here[step]
    here[steps[-1]] = value
    return new


def written(kind: Kind, data: Any) -> str:
    """Return data as the text of a file; what is marked ``@...@`` stands in it as it is."""
    text = json.dumps(data)
    if isinstance(kind.data, tuple):
        text = "".join(json.dumps(event) + "\n" for event in data)
    return re.sub(r'"@(\d+)@"', lambda found: RAW[int(found[1])], text)


RAW = (*NEVER, *WRONG)


def damaged(text: str, rng: random.Random) -> bytes:
    """Return a text with a few bytes of it spoilt, as a card or a cut-off download does it."""
    data = bytearray(text.encode())
    match rng.randrange(6):
        case 0:
            return bytes(data[: rng.randrange(len(data))])
        case 1:
            for _ in range(rng.randrange(1, 4)):
                data[rng.randrange(len(data))] = rng.randrange(256)
        case 2:
            at = rng.randrange(len(data))
            data[at:at] = rng.randbytes(rng.randrange(1, 20))
        case 3:
            return text.encode("utf-16")
        case 4:
            at, length = rng.randrange(len(data)), rng.randrange(1, 30)
            del data[at : at + length]
        case _:
            at, to = sorted(rng.randrange(len(data)) for _ in range(2))
            data[at:at] = data[at:to]
    return bytes(data)


def mutants(kind: Kind) -> Iterator[tuple[bytes, str]]:
    """Yield damaged files, each with why it must be refused; empty where it may still be a good one."""
    rng = random.Random(kind.name)
    for k in range(EACH):
        if k % 3 == 0:
            yield damaged(kind.text or written(kind, kind.data), rng), ""
        elif kind.data is not None:
            yield _mutant_of_json(kind, rng)
        else:
            yield _mutant_of_text(kind, rng)


def _mutant_of_json(kind: Kind, rng: random.Random) -> tuple[bytes, str]:
    leaves = [(at, value) for at, value in places(kind.data) if not at.startswith(kind.torn)]
    looked_at = [
        (at, value)
        for at, value in leaves
        if not any(at == free or at.startswith(f"{free}.") or at.endswith(f".{free}") for free in kind.free)
    ]
    if rng.random() < 0.4:
        at, number = rng.choice(leaves)[0], rng.randrange(len(NEVER))
    else:
        numbers = [at for at, v in looked_at if isinstance(v, float) and not isinstance(v, bool)]
        at, number = rng.choice(numbers), len(NEVER) + rng.randrange(len(WRONG))
    text = written(kind, changed(kind.data, at, f"@{number}@"))
    return text.encode(), f"{RAW[number][:20]} at {at}"


def _mutant_of_text(kind: Kind, rng: random.Random) -> tuple[bytes, str]:
    pattern = r"(?<=[=\[, \t])-?\d+(?:\.\d+)?(?=[,\]\s}])"
    quoted = [(m.start(), m.end()) for m in re.finditer(r'"[^"\n]*"|#[^\n]*', kind.text)]
    if kind.name.endswith(".param"):
        pattern, spoilt = r"(?<=[, \t])-?\d+(?:\.\d+)?(?=\t9|\n)", NEVER_LINES
    else:
        spoilt = NEVER_TOML
    found = [m for m in re.finditer(pattern, kind.text) if not any(a < m.start() < b for a, b in quoted)]
    one, other = rng.choice(found), rng.choice(spoilt)
    text = kind.text[: one.start()] + other + kind.text[one.end() :]
    return text.encode(), f"{other[:20]} for {one[0]}"


def outcome(kind: Kind, path: Path) -> str:
    """Return the message of a rejection, or "" if the file is accepted; other errors are tracebacks and fail."""
    try:
        kind.load(path)
    except REFUSALS as error:
        return str(error)
    return ""


def holds(kind: Kind, data: bytes) -> bool:
    """Whether an accepted file conforms to its published schema; a foreign side file is ignored."""
    try:
        reported = parse(data)
    except Refused:
        return kind.name == "side.json" or not kind.schema
    left_alone = kind.name == "side.json" and "marks" not in reported and not {"ending", "meta"} <= set(reported)
    return not kind.schema or left_alone or SCHEMAS[kind.schema].is_valid(reported)


@pytest.mark.parametrize("name", KINDS)
def test_a_valid_file_is_accepted(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    path = tmp_path / name
    path.write_text(kind.text or written(kind, kind.data))
    assert outcome(kind, path) == ""


@pytest.mark.parametrize("name", KINDS)
def test_a_damaged_file_is_rejected_in_one_line_and_no_nonsense_accepted(name: str, tmp_path: Path) -> None:
    kind, path = KINDS[name], tmp_path / name
    taken, wordy, damaged = [], [], list(mutants(kind))
    for data, why in damaged:
        path.write_bytes(data)
        reported = outcome(kind, path)
        if not reported and (why or not holds(kind, data)):
            taken.append(why or "against the schema")
        if len(reported) >= LONGEST or "\n" in reported:
            wordy.append(reported)
    assert len(damaged) >= EACH
    assert taken == []
    assert wordy == []


@pytest.mark.parametrize(("name", "at"), [(n, at) for n, kind in KINDS.items() for at in kind.positive])
def test_values_that_must_be_positive_are_rejected_if_negative(name: str, at: str, tmp_path: Path) -> None:
    kind, path = KINDS[name], tmp_path / name
    for value in (-1.0, -1e-9, -1e30):
        path.write_text(written(kind, changed(kind.data, at, value)))
        assert outcome(kind, path)


def test_there_are_at_least_a_thousand_files() -> None:
    assert EACH * len(KINDS) >= 1000
