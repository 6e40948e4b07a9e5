"""The JSON Schema accepts what armgpi reads, by another reader (jsonschema), and names what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from commands import Answer
from jsonschema import Draft202012Validator

from armgpi.config.json_schema import json_schema
from armgpi.config.schema import CONTROLLERS

EXAMPLES = Path(__file__).parents[2] / "examples"
SCHEMA = json_schema()
VALIDATOR = Draft202012Validator(SCHEMA)


def problems(data: Any) -> list[str]:
    return ["/".join(map(str, error.absolute_path)) for error in VALIDATOR.iter_errors(data)]


def test_it_is_a_schema_and_plain_json() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    json.dumps(SCHEMA, allow_nan=False)


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.yaml")), ids=lambda file: file.stem)
def test_examples_are_accepted(file: Path) -> None:
    data = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert problems(data) == []


def test_every_controller_is_accepted() -> None:
    data = {"robot": {"name": "ur5"}, "controllers": [{"type": kind} for kind in CONTROLLERS]}
    assert problems(data) == []


@pytest.mark.parametrize(
    ("data", "place"),
    [
        ({"robot": {"name": "ur5"}, "sample_tme": 1e-3}, ""),
        ({"sample_time": -1.0}, "sample_time"),
        ({"controllers": [{"type": "nonsense"}]}, "controllers/0"),
        ({"plant": {"delay": "x", "dely": 1}}, "plant"),
        ({"record_every": 1.5}, "record_every"),
    ],
)
def test_what_armgpi_refuses_is_marked(data: dict[str, Any], place: str) -> None:
    assert place in problems(data)


def test_the_command_writes_it(cli: Callable[..., Answer], tmp_path: Path) -> None:
    answer = cli("schema", "-o", str(tmp_path / "armgpi.schema.json"))
    assert answer.code == 0
    assert "# yaml-language-server: $schema=armgpi.schema.json" in answer.out
    assert json.loads((tmp_path / "armgpi.schema.json").read_text(encoding="utf-8")) == SCHEMA
