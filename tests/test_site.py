"""The documentation site: reference pages generated from the code, executed pages, schemas, links."""

from __future__ import annotations

import argparse
import json
import math
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.api import example_run, fit, save_model
from gcs_autotune.cli import COMMANDS, make_parser
from gcs_autotune.effects import EFFECTS, EffectInstance, ExtendedModel
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import load_model
from sitl import VEHICLES, open_vehicle
from sitl.catalogue import load_vehicle
from sitl.effects import parse_effect

from .conftest import module_of_the_docs

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


BUILD = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from sphinx.cmd.build import main
from tests.conftest import in_few_evaluations
with in_few_evaluations():
    sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("reference")
    module_of_the_docs("site_reference").write(folder)
    return {path.stem: path.read_text() for path in folder.glob("*.md")}


def test_the_page_of_commands_has_every_verb_and_every_option(pages):
    reported = pages["commands"]
    assert [verb for verb in COMMANDS if not re.search(rf"^## {verb}$", reported, re.MULTILINE)] == []
    missing = []

    def walk(parser: argparse.ArgumentParser) -> None:
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for below in action.choices.values():
                    walk(below)
            elif action.dest not in ("help", "version") and action.help is not argparse.SUPPRESS:
                missing.extend(o for o in action.option_strings if o not in reported)

    walk(make_parser())
    assert missing == []


def test_the_page_of_parameters_lists_all_that_a_tune_may_write(pages):
    gains = {g.parameter for f in FIRMWARE.values() for a in f.axes.values() for g in a.gains}
    assert gains
    assert [name for name in gains if f"`{name}`" not in pages["parameters"]] == []


def test_a_page_shows_commands_with_output_and_a_failure_fails_the_build(tmp_path):
    site_run = module_of_the_docs("site_run")
    shown = site_run.on_a_terminal(["gcs-autotune fly --list"], tmp_path)
    assert shown.startswith("$ gcs-autotune fly --list\nzig-zag\n")
    assert max(map(len, shown.splitlines())) <= 80
    with pytest.raises(RuntimeError, match="exit code 6"):
        site_run.on_a_terminal(["gcs-autotune identify none.csv"], tmp_path)


def test_the_bibliography_has_every_entry(pages):
    keys = re.findall(r"^@\w+\{(\w+),", (DOCS / "references.bib").read_text(), re.MULTILINE)
    assert [key for key in keys if not re.search(rf"^{key}$", pages["bibliography"], re.MULTILINE)] == []


def test_every_effect_has_a_how_to_with_valid_commands(pages):
    site, reported = module_of_the_docs("site_reference"), pages["hide_and_find"]
    assert set(site.ABOARD) == set(EFFECTS)
    for slug in EFFECTS:
        section = reported.partition(f"\n## {slug}\n")[2].partition("\n## ")[0]
        flown, found = re.findall(r"^gcs-autotune (.*)$", section, re.MULTILINE)
        args = make_parser().parse_args(shlex.split(flown))
        assert args.connect == site.link_with(slug)
        assert make_parser().parse_args(shlex.split(found)).runs == [args.out]
        assert "Shown by" in section


@pytest.mark.parametrize("slug", list(EFFECTS))
def test_the_vehicle_of_a_how_to_hides_its_effect(slug):
    _, vehicle, size = module_of_the_docs("site_reference").ABOARD[slug]
    open_vehicle(vehicle, effects=[parse_effect(f"{slug}{size}")], seed=3)


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_is_flown_for_its_plots(name):
    site, data = module_of_the_docs("site_vehicles"), load_vehicle(name)
    seen = site.manoeuvres_of(data)
    for record in (seen.run_up, seen.circle, seen.zigzag, seen.decay, seen.release):
        assert all(np.isfinite(values).all() for values in record.values())
    assert seen.run_up["u"][-1] > 0.0
    assert seen.circle["psi"][-1] - seen.circle["psi"][0] > 2.0 * math.pi
    assert set(seen.zigzag["N"]) == {site.STEERING, -site.STEERING}
    assert set(seen.release) - {"t"} == {c for c, h in (("phi", "roll"), ("theta", "pitch")) if h in data.tables} | (
        {"z"} if "waterplane" in data.tables.get("body", {}) else set()
    )
    for column, values in seen.release.items():
        assert column == "t" or abs(values[-1]) < 0.6 * abs(values[0])


def test_the_plots_of_a_linear_boat_match_its_file():
    site, data = module_of_the_docs("site_vehicles"), load_vehicle("blueboat")
    seen = site.manoeuvres_of(data)
    assert seen.run_up["u"][-1] == pytest.approx(55.2 / 29.35, rel=0.02)
    assert seen.circle["r"][-1] == pytest.approx((2.0 * 0.3 * 55.2 * 0.285 + 0.2) / 44.65, rel=1e-6)
    time = np.interp(-math.exp(-1.0), -seen.decay["u"] / seen.decay["u"][0], seen.decay["t"])
    assert time == pytest.approx(41.77 / 29.35, rel=1e-3)
    assert site.sources_of(data) == "Sources: jankristia/BlueBoatSystemIdentification. Assumed: 1 of 10 numbers."
    picture = site.picture_of(data)
    assert picture.startswith("<svg ") and all(word in picture for word in ("circle", "zig-zag", "steps", "free decay"))


def test_every_page_is_in_the_contents():
    contents = (DOCS / "index.md").read_text()
    own = {p.relative_to(DOCS).with_suffix("").as_posix() for p in DOCS.rglob("*.md") if "_build" not in p.parts}
    listed = set(re.findall(r"^[a-z-]+(?:/[a-z0-9_-]+)*$", contents, re.MULTILINE))
    assert {page for page in own - {"index"} if not page.startswith("decisions/0")} - listed == set()


def test_model_files_conform_to_their_schema(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((DOCS / "reference" / "model-file.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    save_model(fit(example_run(), "linear", dof="yaw", delay=0.0), tmp_path / "axis.json")
    axis = load_model(tmp_path / "axis.json").model
    extended = ExtendedModel(axis.base, (EffectInstance("dead-zone", "N", {"width": 0.1}),))
    written = json.loads((tmp_path / "axis.json").read_text())
    for document in (written, axis.base.to_dict(), extended.to_dict()):
        assert list(validator.iter_errors(document)) == []
    assert list(validator.iter_errors({**written, "alpha": "much"})) != []


@pytest.mark.slow
@pytest.mark.timeout(1200)  # two tunes are flown meanwhile
def test_the_site_builds_without_warnings_and_its_links_are_valid(tmp_path):
    """Pages are executed; one that fails fails the build. Their tunes design in few evaluations: at its full
    length one is flown in ``tests/cli/test_command_line.py``.
    """
    for needed in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(needed, reason=f"{needed} is not installed (pip install '.[docs]')")
    command = [sys.executable, "-c", BUILD, "-q", "-W", "--keep-going", "-b", "html", str(DOCS), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    lost = []
    for page in tmp_path.rglob("*.html"):
        for link in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:", link) and not (page.parent / link).exists():
                lost.append(f"{page.name}: {link}")
    assert lost == []
