"""A JSON schema of study files: a scene's tables, and those of a study beside them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from cpmkit.scenefile.documented_keys import Key, keys_of
from cpmkit.scenefile.scene_schema import DRAFT, definitions, scene_tables, table_of
from cpmkit.studies.studyfile import Exact
from cpmkit.studies.sweep import Sweep, listed


def study_schema() -> dict[str, Any]:
    """Return the schema of study files; names of [let] may stand for numbers, which it therefore does not check."""
    tables = {name: _without_types(table) for name, table in scene_tables(problem_needs=False).items()}
    lists = [Key(key, "list", "list", False, None, f"Values of {name}.") for name, key in listed().items()]
    sweep = [key for key in keys_of(Sweep) if key.name in {one.name for one in fields(Sweep)} - {"lists"}]
    return {
        "$schema": DRAFT,
        "title": "A study of cpmkit",
        "type": "object",
        "properties": {
            "title": {"description": "For the report.", "type": "string"},
            **{name: table for name, table in tables.items() if name != "output"},
            "let": {"description": "Names of formulas for the rest of the file.", "type": "object"},
            "exact": table_of(keys_of(Exact)),
            "sweep": table_of([*sweep, *lists]),
        },
        "required": ["surface", "problem", "exact", "sweep"],
        "additionalProperties": False,
        "definitions": _without_types(definitions()),
    }


def _without_types(schema: Any) -> Any:
    """Return a schema in which any key may hold text that is a name of [let]."""
    if isinstance(schema, list):
        return [_without_types(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {"number", "integer"} & set([schema["type"]] if isinstance(schema.get("type"), str) else [])
    kept = {key: value for key, value in schema.items() if not (plain and key == "type")}
    return {key: _without_types(value) for key, value in kept.items()}
