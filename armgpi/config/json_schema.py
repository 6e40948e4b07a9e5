"""JSON Schema of experiment files, for editors that complete keys and mark what is wrong while one types.

It accepts every file that armgpi reads; armgpi checks more, such as names of joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from armgpi.base.parameter import Parameter, notes
from armgpi.base.renamed import CONTROLLERS as OLD_CONTROLLERS
from armgpi.config.schema import CONTACTS, CONTROLLERS, LOADS, PATHS, ExperimentConfig
from armgpi.config.section import Key, Section

#: Keys of sections that are told apart by their `type` -> group of definitions, whether it is a list.
_VARIANTS: Mapping[str, tuple[str, bool]] = {
    "controllers": ("controllers", True),
    "loads": ("loads", True),
    "environment": ("contacts", True),
    "path": ("paths", False),
}
_GROUPS: Mapping[str, Mapping[str, type[Section]]] = {
    "controllers": CONTROLLERS,
    "loads": LOADS,
    "contacts": CONTACTS,
    "paths": PATHS,
}
#: Kinds of parameters whose value has one type of JSON.
_TYPES = {"integer": "integer", "seed": "integer", "flag": "boolean", "text": "string"}


def json_schema() -> dict[str, Any]:
    """Return the schema of experiment files as plain data (JSON Schema, draft 2020-12)."""
    definitions = {}
    for group, kinds in _GROUPS.items():
        for name, kind in kinds.items():
            definitions[f"{group}.{name}"] = _section(kind, name)
    whole = _section(ExperimentConfig)
    whole["properties"]["tune"] = {"type": "object", "description": "what `armgpi tune` searches"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "armgpi experiment file",
        **whole,
        "$defs": definitions,
    }


def _section(kind: type[Section], name: str = "") -> dict[str, Any]:
    """Return the schema of a section; of one that is told apart by its `type`, with that name."""
    notes_of_keys = notes(kind)
    properties = {}
    for key, facts in kind.keys.items():
        properties[key] = _key(key, facts, notes_of_keys.get(key, ""))
    schema: dict[str, Any] = {"type": "object", "properties": properties, "additionalProperties": False}
    if name:
        old_names = [old for old, new in OLD_CONTROLLERS.items() if new == name]
        properties["type"] = {"enum": [name, *old_names]}
        schema["required"] = ["type"]
    return schema


def _key(name: str, key: Key, note: str) -> dict[str, Any]:
    """Return the schema of what may stand at a key; `note` says what it is where nothing is declared."""
    declared = key.declared
    text = declared.meaning if declared is not None else note
    facts = {"description": text} if text else {}
    nested = getattr(key.form, "__self__", None)
    value: dict[str, Any]
    if name in _VARIANTS:
        group, is_list = _VARIANTS[name]
        references = [{"$ref": f"#/$defs/{group}.{kind}"} for kind in _GROUPS[group]]
        value = {"anyOf": references}
        if is_list:
            value = {"type": "array", "items": value}
    elif nested is not None:
        # A robot may be its name, and a section with short forms more: armgpi looks at these.
        value = {"anyOf": [_section(nested), {"type": ["string", "number", "array", "boolean"]}]}
    elif declared is not None:
        value = _declared(declared)
    else:
        value = {}
    if value and (key.optional or key.default is None):
        value = {"anyOf": [value, {"type": "null"}]}
    return {**facts, **value}


def _declared(declared: Parameter) -> dict[str, Any]:
    """Return the schema of a declared parameter; empty where its form is no plain one."""
    if declared.kind == "choice":
        return {"enum": [*declared.choices]}
    if declared.kind in _TYPES:
        return {"type": _TYPES[declared.kind]}
    if declared.kind != "number":
        return {}
    limits = {}
    if math.isfinite(declared.least):
        limits["exclusiveMinimum" if declared.above else "minimum"] = declared.least
    if math.isfinite(declared.most):
        limits["exclusiveMaximum" if declared.below else "maximum"] = declared.most
    # YAML 1.1 reads 1e-3 as text, and armgpi as a number.
    number = {"anyOf": [{"type": "number", **limits}, {"type": "string"}]}
    if declared.unlimited:
        number = {"anyOf": [*number["anyOf"], {"type": "null"}]}
    if not declared.per_joint:
        return number
    as_list = {"type": "array", "items": number}
    by_name = {"type": "object", "additionalProperties": number}
    return {"anyOf": [number, as_list, by_name]}
