"""Every file that a command writes, and every example of a user file, conforms to its schema in the docs."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import diagnosis_stories
import pytest
import report_stories

from gcs_autotune.api import Fit, example_run, fit, save_model
from gcs_autotune.cli import main, read_config
from gcs_autotune.errors import AutotuneError
from gcs_autotune.link import Journal
from gcs_autotune.report import write_story
from gcs_autotune.workflow import CommonSettings, Connection, load_flight_plan

from .conftest import module_of_the_docs
from .identify.coupled.test_bad_coupled_runs import sailed

jsonschema = pytest.importorskip("jsonschema")
referencing = pytest.importorskip("referencing")

DOCS = Path(__file__).parents[1] / "docs"
SCHEMAS = {path.name.removesuffix(".schema.json"): path for path in (DOCS / "reference").glob("*.schema.json")}
VEHICLES = Path(__file__).parents[1] / "sitl" / "vehicles"
TOML = re.compile(r"^```toml\n(.*?)^```", re.MULTILINE | re.DOTALL)


@cache
def validator(name: str) -> Any:
    resources = [(p.name, referencing.Resource.from_contents(json.loads(p.read_text()))) for p in SCHEMAS.values()]
    schema = json.loads(SCHEMAS[name].read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema, registry=referencing.Registry().with_resources(resources))


def troubles(name: str, document: Any) -> list[str]:
    return [error.message[:200] for error in validator(name).iter_errors(document)]


def of_the_docs(kind: str) -> list[tuple[str, str]]:
    """Return (page, TOML) of every block in the docs that is a plan, or settings."""
    found = []
    for page in sorted(DOCS.rglob("*.md")):
        for block in TOML.findall(page.read_text(encoding="utf-8")):
            is_plan = "[[run]]" in block
            if is_plan == (kind == "plan-file") and (is_plan or "[link]" in block or "[limits]" in block):
                found.append((page.name, block))
    return found


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run directory of a plan, flown on the command line."""
    folder = tmp_path_factory.mktemp("flown")
    plan = folder / "two.toml"
    plan.write_text('[defaults]\nduration = 40\n[[run]]\nmanoeuvre = "doublets"\nsides = "both"\n')
    run = folder / "run"
    assert main(["fly", str(plan), "--connect", "sitl:blueboat", "--quiet", "--json", "--out", str(run)]) == 0
    return run


def test_each_kind_of_file_has_a_schema_linked_from_the_formats_page() -> None:
    kinds = ("diagnosis", "figures", "fit", "gains", "model", "plan", "settings", "summary", "trial", "vehicle")
    assert set(SCHEMAS) == {"journal", *(f"{kind}-file" for kind in kinds)}
    formats = (DOCS / "reference" / "formats.md").read_text()
    assert [path.name for path in SCHEMAS.values() if f"]({path.name})" not in formats] == []


@pytest.mark.parametrize("name", ["plan-file", "settings-file", "vehicle-file"])
def test_the_schemas_made_from_tables_are_current(name: str) -> None:
    made = module_of_the_docs("site_schemas").text_of(f"{name}.schema.json")
    assert SCHEMAS[name].read_text(encoding="utf-8") == made, "run: PYTHONPATH=. python3 docs/site_schemas.py"


KINDS = (("trials/*", "trial"), ("model*", "model"), ("fit*", "fit"), ("parameters_*", ""), ("setting_out", ""))
KINDS += tuple((name, name) for name in ("summary", "gains", "figures", "diagnosis"))


def strictly(path: Path) -> Any:
    """Read JSON as a browser or jq would: NaN and Infinity are none of it."""

    def refused(word: str) -> None:
        raise AssertionError(f"{path.name} has {word}")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refused)


def troubles_in(folder: Path) -> dict[str, list[str]]:
    """What every JSON file in a run directory has against its schema; a file that has none is a trouble, too."""
    found = {}
    for path in folder.rglob("*.json"):
        within = path.relative_to(folder).with_suffix("")
        kinds = [kind for pattern, kind in KINDS if within.match(pattern)]
        reported = strictly(path)
        found[str(within)] = ["no schema"] if not kinds else troubles(f"{kinds[0]}-file", reported) if kinds[0] else []
    return {name: each for name, each in found.items() if each}


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_every_file_of_a_tune_a_zig_zag_and_a_diagnosis_conforms_to_a_schema(tmp_path: Path) -> None:
    tuned, flown = tmp_path / "tuned", tmp_path / "flown"
    assert main(["tune", "heading", "--connect=sitl:charlie?seed=1", "--quiet", f"--out={tuned}"]) == 0
    assert main(["fly", "zig-zag", "--connect=sitl:charlie?seed=1", "--quiet", f"--out={flown}"]) == 0
    effects = ["--effects=input-bias,dead-zone", f"--out={tmp_path / 'told'}", "--quiet"]
    assert main(["diagnose", str(flown), "--dof=yaw", *effects]) == 0
    assert {p.name for p in tuned.glob("*.json")} >= {"summary.json", "gains.json", "fit.json", "model.json"}
    assert (flown / "figures.json").exists() and (tmp_path / "told" / "diagnosis.json").exists()
    assert [troubles_in(folder) for folder in (tuned, flown, tmp_path / "told")] == [{}, {}, {}]


@pytest.mark.slow
@pytest.mark.parametrize("name", report_stories.STORIES)
def test_the_files_of_a_tune_conform_to_their_schemas_for_every_ending(name: str, tmp_path: Path) -> None:
    write_story(report_stories.STORIES[name](), tmp_path)
    assert (tmp_path / "summary.json").exists()
    assert troubles_in(tmp_path) == {}


@pytest.mark.parametrize("name", diagnosis_stories.STORIES)
def test_every_diagnosis_conforms_to_its_schema(name: str) -> None:
    data = json.loads(diagnosis_stories.STORIES[name]().to_json())
    assert troubles("diagnosis-file", data) == []
    assert troubles("diagnosis-file", {**data, "verdict": "perhaps"}) != []


@pytest.mark.slow
def test_the_files_of_a_flight_conform_to_the_schemas(flown: Path) -> None:
    assert troubles("plan-file", tomllib.loads((flown / "plan.toml").read_text())) == []
    lines = [json.loads(line) for line in (flown / "journal.jsonl").read_text().splitlines()]
    assert {event["event"] for event in lines} == {"opened", "ordering", "ordered", "closed"}
    assert [trouble for line in lines for trouble in troubles("journal", line)] == []
    fits, models = list(flown.glob("fit*.json")), list(flown.glob("model*.json"))
    assert fits and models
    for path in fits:
        assert troubles("fit-file", json.loads(path.read_text())) == []
    for path in models:
        assert troubles("model-file", json.loads(path.read_text())) == []


def test_every_journal_event_conforms_to_its_schema(tmp_path: Path) -> None:
    """The events are those that the source records."""
    sources = "".join(p.read_text() for p in (DOCS.parent / "gcs_autotune").rglob("*.py"))
    orders = set(re.findall(r'on_order\("(\w+)"', sources))
    recorded = set(re.findall(r'ournal\.record\(\s*"(\w+)"', sources)) | {"opened", "closed"} | orders
    journal = Journal(tmp_path / "journal.jsonl", mode="HOLD", armed=False, fingerprint={"A": 1.0})
    others = {"opened", "closed", "resumed", "kept", "mission_writing", "mission_returned"}
    for event in sorted(recorded - others - {"script_writing", "script_removed"} - orders):
        journal.record(event, name="ATC_STR_RAT_P", value=0.2)
    journal.record("ordering", mode="GUIDED", boot=12.5)
    journal.record("ordered", mode="GUIDED")
    journal.record("ordering", armed=True)
    journal.record("yielded", mode="HOLD")
    journal.record("kept", values={"ATC_STR_RAT_P": 0.2})
    journal.record("mission_writing", items=[{"command": 16, "x": 1}], ours=[], current=1)
    journal.record("mission_returned")
    journal.record("script_writing", path="APM/scripts/x.lua")
    journal.record("script_removed", path="APM/scripts/x.lua")
    journal.close()
    Journal.resume(tmp_path / "journal.jsonl").close()
    lines = [json.loads(line) for line in (tmp_path / "journal.jsonl").read_text().splitlines()]
    assert {line["event"] for line in lines} == recorded
    assert [trouble for line in lines for trouble in troubles("journal", line)] == []
    assert troubles("journal", {**lines[0], "armed": "yes"}) != []
    assert troubles("journal", {"event": "lent", "time": "now", "name": "A"}) != []


@pytest.mark.parametrize("dof", ["yaw", "horizontal"])
def test_the_files_of_identify_conform_to_the_schemas(dof: str, tmp_path: Path) -> None:
    if dof == "yaw":
        found: Fit = fit(example_run(), dof="yaw")
    else:
        found = fit([sailed(seed) for seed in (1, 2)], dof="horizontal", delay=0.0)
    save_model(found, tmp_path / "model.json")
    assert troubles("fit-file", json.loads(found.to_json())) == []
    assert troubles("model-file", json.loads((tmp_path / "model.json").read_text())) == []


def accepted(name: str, text: str, folder: Path) -> Iterator[bool]:
    """Yield whether the schema takes a file, and whether the program does."""
    try:
        yield troubles(name, tomllib.loads(text)) == []
    except tomllib.TOMLDecodeError:
        yield False
    path = folder / "file.toml"
    path.write_text(text)
    try:
        if name == "settings-file":
            read_config(path)
        else:
            load_flight_plan(path, CommonSettings(Connection("udpin:127.0.0.1:1"), folder), None, None)
        yield True
    except AutotuneError:
        yield False


WRONG = [
    ("settings-file", "[limits]\nmax-distance = 1e9\n"),
    ("settings-file", "[limits]\nmax-distanse = 40\n"),
    ("settings-file", "[link]\nconnect = 5\n"),
    ("settings-file", "[lnk]\n"),
    ("plan-file", ""),
    ("plan-file", "[[run]]\nheading = 10\n"),
    ("plan-file", '[[run]]\nmanoeuvre = "zigzag"\n'),
    ("plan-file", '[[run]]\nmanoeuvre = "zig-zag"\nduration = 10\n'),
    ("plan-file", '[[run]]\nmanoeuvre = "zig-zag"\nheading = 900\n'),
    ("plan-file", '[[run]]\nmanoeuvre = "zig-zag"\nrepeat = 0\n'),
    ("plan-file", '[[run]]\nmanoeuvre = "zig-zag"\nhold-out = 1\n'),
    ("plan-file", 'order = "any"\n[[run]]\nmanoeuvre = "zig-zag"\n'),
    ("plan-file", '[[run]]\nmanoeuvre = "step"\n'),
]


@pytest.mark.parametrize(("name", "text"), WRONG)
def test_the_schema_rejects_what_the_program_rejects(name: str, text: str, tmp_path: Path) -> None:
    assert list(accepted(name, text, tmp_path)) == [False, False]


@pytest.mark.parametrize("name", ["plan-file", "settings-file"])
def test_every_example_in_the_docs_is_accepted_by_program_and_schema(name: str, tmp_path: Path) -> None:
    examples = of_the_docs(name)
    if name == "plan-file":
        examples += [(own, (DOCS / own).read_text()) for own in ("three.toml", "tugboat.toml")]
    assert examples
    assert [page for page, text in examples if list(accepted(name, text, tmp_path)) != [True, True]] == []


@pytest.mark.parametrize("path", sorted(VEHICLES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_vehicle_conforms_to_the_schema_and_one_in_pounds_does_not(path: Path) -> None:
    reported = tomllib.loads(path.read_text())
    assert troubles("vehicle-file", reported) == []
    assert (
        troubles("vehicle-file", {**reported, "surge": {"alpha": {"value": 90.0, "unit": "lb", "source": "x"}}}) != []
    )
