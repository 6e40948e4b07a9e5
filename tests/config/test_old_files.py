"""Files of earlier versions load with their old meaning; files of later ones are refused by their format."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from armgpi import Robot, config
from armgpi.config import building, world
from armgpi.errors import ConfigError
from armgpi.plants.plant import inside

FOLDER = Path(__file__).parents[1] / "fixtures" / "old_files"
MIDDLE = Robot.load("anthropomorphic3").middle().tolist()


def built(name: str) -> building.Experiment:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return config.build(*config.read(FOLDER / name))


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_an_old_file_has_a_line_that_says_so_and_starts_where_it_did(path: Path) -> None:
    found = built(path.name)
    assert found.config.ideal is None
    assert found.config.format == 1
    assert "it has no key `ideal`" in world.describe(found.config, found.robot)
    assert found.config.reference.points[0] == MIDDLE


def test_an_old_file_that_states_nothing_is_rigid_with_exact_positions() -> None:
    found = built("bare.yaml")
    assert found.config.plant.encoder_bits is None
    assert not found.robot.armature.any()
    assert [each.type for each in found.config.controllers] == ["gpi"]


def test_old_words_have_their_new_meaning() -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        config.read(FOLDER / "words.yaml")
    said = [str(each.message) for each in told if issubclass(each.category, DeprecationWarning)]
    assert any("'stiff'" in text for text in said)
    assert any("'gpi_auto'" in text for text in said)
    found = built("words.yaml")
    assert [each.type for each in found.config.controllers] == ["gpi_auto"]
    assert found.config.plant.engine == "armgpi"  # stiff joints


def test_friction_of_an_old_file_stays_out_of_its_plant_and_other_joints_stay() -> None:
    found = built("part.yaml")
    assert vars(inside(found.plant))["friction"] is None
    assert found.config.reference.points[1] == [0.4, *MIDDLE[1:]]


def test_what_is_written_has_a_format_and_loads_again(tmp_path: Path) -> None:
    text = config.dump(built("part.yaml").config)
    assert text.startswith("format: 1\n") or "\nformat: 1\n" in text
    again = config.build(*config.parse(text, "written"))
    assert again.config == built("part.yaml").config


def test_a_file_of_a_later_format_is_refused_by_that(tmp_path: Path) -> None:
    path = tmp_path / "later.yaml"
    path.write_text("format: 2\nrobot: {name: anthropomorphic3}\nnew_key: 1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="format"):
        config.read(path)
