"""What YAML 1.1 and YAML 1.2 read differently is no number by accident, and a name stays one."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from armgpi import config
from armgpi.base.yaml_text import parse
from armgpi.errors import ConfigError


@pytest.mark.parametrize("number", ["1:30", "-1:30", "1:30.5", "1:00:00", "010", "-017", "0_7"])
def test_a_number_of_another_base_is_refused_with_its_line(number: str, tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(f"robot: anthropomorphic3\nt_final: {number}\n")
    assert not isinstance(yaml.safe_load(number), str)  # PyYAML makes a number of it
    with pytest.raises(ConfigError, match=r"e\.yaml:2: .*is a number of base (8|60) in YAML 1\.1"):
        config.read(path)


@pytest.mark.parametrize("number", ["0", "90", "-1.5", "1.0e+3", "0.5", "1_000"])
def test_a_plain_number_is_that_number(number: str) -> None:
    assert parse(f"x: {number}", "text").data["x"] == float(number)


@pytest.mark.parametrize("word", ["yes", "No", "on", "OFF"])
def test_a_word_is_a_name_and_no_truth(word: str) -> None:
    assert parse(f"{word}: {word}", "text").data == {word: word}


@pytest.mark.parametrize("word", ["true", "False"])
def test_true_and_false_are(word: str) -> None:
    assert parse(f"x: {word}", "text").data["x"] is (word == "true")


def test_text_in_quotes_stays_text() -> None:
    assert parse("x: '1:30'", "text").data["x"] == "1:30"


def test_a_number_is_not_a_word(tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    path.write_text("robot: anthropomorphic3\nt_final: on\n")
    with pytest.raises(ConfigError, match="t_final"):
        config.read(path)


def test_every_key_and_every_entry_of_a_list_has_its_line() -> None:
    text = "a:\n- 1\n\n- b: 2\n  c: [3,\n    4]\nd: {e: 5}\n"
    assert parse(text, "text").lines == {
        ("a",): 1,
        ("a", 0): 2,
        ("a", 1): 4,
        ("a", 1, "b"): 4,
        ("a", 1, "c"): 5,
        ("a", 1, "c", 0): 5,
        ("a", 1, "c", 1): 6,
        ("d",): 7,
        ("d", "e"): 7,
    }
