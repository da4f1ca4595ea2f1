"""JSON schemas of the files that people write, made from the tables that read them:

python3 docs/site_schemas.py        # writes those of MADE into docs/reference
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from gcs_autotune.cli.config_file import TABLES
from gcs_autotune.limits import axes_of
from gcs_autotune.manoeuvres import MANOEUVRES
from gcs_autotune.workflow.flight_plan import MOST_RUNS
from sitl.vehicle_file import VehicleFile

REFERENCE = Path(__file__).parent / "reference"
DRAFT = "https://json-schema.org/draft/2020-12/schema"
TEXT = {"type": "string", "minLength": 1}
TRUTH = {"type": "boolean"}
SIDES = {"enum": ["starboard", "port", "both"]}


def number(name: str) -> dict[str, Any]:
    """Return the schema of a number of the table of limits, in the unit it is typed in."""
    rows = axes_of(name)
    least, greatest = min(row.least for row in rows), max(row.greatest for row in rows)
    if any(row.signed for row in rows):
        least = -greatest
    unit = f" [{rows[0].unit}]" if rows[0].unit else ""
    kind = "integer" if all(row.whole for row in rows) else "number"
    return {"type": kind, "minimum": least, "maximum": greatest, "description": f"{rows[0].meaning}{unit}"}


def levels(name: str) -> dict[str, Any]:
    """Return the schema of a number in a plan: itself, or a list of levels, a run for each."""
    one = number(name)
    return {"description": one.pop("description"), "anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}


def _references(names: Iterable[str]) -> dict[str, Any]:
    return {name: {"$ref": f"#/$defs/{name}"} for name in names}


def plan() -> dict[str, Any]:
    """Return the schema of a plan for ``fly PLAN.toml``."""
    flown = {kind.name: kind for kind in MANOEUVRES.values() if kind.is_alone}
    options = sorted({name for kind in flown.values() for name in kind.options})
    common = {
        "force": {"enum": list("XYZKMN")},
        "sides": {"anyOf": [SIDES, {"type": "array", "items": SIDES, "minItems": 1}]},
        "repeat": {"type": "integer", "minimum": 1, "maximum": MOST_RUNS},
        "hold-out": TRUTH,
        **_references(("throttle", "speed")),
    }
    runs = [
        {
            "properties": {"manoeuvre": {"const": name}, **common, **_references(kind.options)},
            "required": ["manoeuvre"],
            "additionalProperties": False,
        }
        for name, kind in flown.items()
    ]
    return {
        "$schema": DRAFT,
        "title": "gcs_autotune plan of manoeuvres",
        "type": "object",
        "required": ["run"],
        "additionalProperties": False,
        "$defs": {name: levels(name) for name in ("throttle", "speed", *options)},
        "properties": {
            "title": TEXT,
            "order": {"enum": ["listed", "shuffled"]},
            "area": TEXT,
            "conditions": {
                "type": "object",
                "properties": {"calm": TRUTH, "min-depth": number("min-depth")},
                "additionalProperties": False,
            },
            "defaults": {
                "type": "object",
                "properties": {**common, **_references(options)},
                "additionalProperties": False,
            },
            "run": {
                "type": "array",
                "minItems": 1,
                "maxItems": MOST_RUNS,
                "items": {"type": "object", "required": ["manoeuvre"], "oneOf": runs},
            },
        },
    }


def settings() -> dict[str, Any]:
    """Return the schema of ``gcs-autotune.toml``."""
    texts = {"connect", "backend", "signing-key"}
    tables = {
        table: {
            "type": "object",
            "properties": {name: TEXT if name in texts else number(name) for name in names},
            "additionalProperties": False,
        }
        for table, names in TABLES.items()
    }
    whole = {name: each for table in tables.values() for name, each in table["properties"].items()}
    one = {"type": "object", "properties": whole, "additionalProperties": False}
    tables["craft"] = {"type": "object", "additionalProperties": one}
    return {
        "$schema": DRAFT,
        "title": "gcs-autotune.toml",
        "type": "object",
        "properties": tables,
        "additionalProperties": False,
    }


def vehicle() -> dict[str, Any]:
    """Return the schema of a vehicle file of the simulator, from the types that read it."""
    (schema,), parts = msgspec.json.schema_components((VehicleFile,), ref_template="#/$defs/{name}")
    whole = parts.pop(schema["$ref"].rpartition("/")[2])
    return {"$schema": DRAFT, **whole, "title": "vehicle file of the simulator", "$defs": dict(sorted(parts.items()))}


MADE = {"plan-file.schema.json": plan, "settings-file.schema.json": settings, "vehicle-file.schema.json": vehicle}
"""File in docs/reference -> what makes it."""


def text_of(name: str) -> str:
    """Return what the file is to hold."""
    return json.dumps(MADE[name](), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for each in MADE:
        (REFERENCE / each).write_text(text_of(each), encoding="utf-8")
