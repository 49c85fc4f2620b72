"""A JSON schema of the scene files of applications."""

from __future__ import annotations

from cpmkit.scenefile.application_tables import ALONG_KEYS, COLOUR_KEYS
from cpmkit.scenefile.kinds import kinds
from cpmkit.scenefile.schema import DRAFT, Schema, definitions, one_of_kinds, scene_tables

PLACE: Schema = {"description": "A point, or a list of points.", "type": "array"}
IMAGE: Schema = {"description": "A point of the target, or of a curve one formula a coordinate.", "type": "array"}
WAY: Schema = {
    "description": "tangent, backwards, left or right; a vector; or one formula a coordinate.",
    "type": ["string", "array"],
}
COLOURS: Schema = {
    "description": "A colour; colours along the curve; { formula = [...] }; { neumann = 0 } where nothing passes.",
    "type": ["string", "array", "object"],
}
TEXT, NUMBER, WHOLE = ({"type": kind} for kind in ("string", "number", "integer"))


def application_schema(command: str) -> Schema:
    """Return the schema of the scene files that ``cpmkit COMMAND`` makes applications of."""
    tables = {name: table for name, table in scene_tables().items() if name != "problem"}
    own, needed = _TABLES[command]()
    return {
        "$schema": DRAFT,
        "title": f"A scene of `cpmkit {command}`",
        "type": "object",
        "properties": {**tables, **own},
        "required": ["surface", *needed],
        "additionalProperties": False,
        "definitions": definitions(),
    }


def _vectors() -> tuple[Schema, list[str]]:
    along = _on_curves(dict.fromkeys(ALONG_KEYS, WAY))
    vector = {"description": "At all of these points, or one for each.", "type": "array"}
    transport = {"description": "How vectors go on.", "enum": ["parallel", "paper"]}
    return {
        "direction": {"type": "array", "items": {"oneOf": [*along, _closed({"at": PLACE, "vector": vector})]}},
        "vectors": _closed({"transport": transport}, needed=False),
    }, ["direction"]


def _map() -> tuple[Schema, list[str]]:
    curves = _on_curves({"to": IMAGE})
    own: Schema = {
        "initial": {"description": "nearest; one formula a coordinate; or { values = FILE }, a row a vertex."},
        "method": {"enum": ["implicit", "explicit"]},
        "step": {"description": "Of time.", **NUMBER},
        "most_steps": {"description": "After which the run ends.", **WHOLE},
        "rest": {"description": "It ends where a step lowers the energy by less than this share of it.", **NUMBER},
        "texture": {"description": "Of the target: one formula a channel, three for a colour, or { values = FILE }."},
    }
    return {
        "target": {"$ref": "#/definitions/source"},
        "landmark": {"type": "array", "items": {"oneOf": [*curves, _closed({"at": PLACE, "to": IMAGE})]}},
        "map": _closed(own, needed=False),
    }, ["target"]


def _paint() -> tuple[Schema, list[str]]:
    name = {"name": {"description": "For reports.", **TEXT}}
    curves = _on_curves({**name, **dict.fromkeys(COLOUR_KEYS, COLOURS)})
    return {"curve": {"type": "array", "items": {"oneOf": curves}}}, ["curve"]


_TABLES = {"vectors": _vectors, "map": _map, "paint": _paint}


def _on_curves(more: Schema) -> list[Schema]:
    """Return the schemas of a table with the keys of a source and these."""
    sources = [one for one in kinds() if one.sort == "source"]
    variants: list[Schema] = one_of_kinds(sources, more)["oneOf"]
    return variants


def _closed(properties: Schema, needed: bool = True) -> Schema:
    required = {"required": sorted(properties)} if needed else {}
    return {"type": "object", "properties": properties, "additionalProperties": False, **required}
