"""Old public names: each works with a warning that has the new one, and files with old words load."""

from __future__ import annotations

import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import armgpi
from armgpi import config
from armgpi.base import renamed
from armgpi.base.renamed import RenamedWarning
from armgpi.certification.path import PathBound
from armgpi.certification.request import ask
from armgpi.health.reality import Outcome
from armgpi.identification.arm import Estimate
from armgpi.robot.drives import Drives
from armgpi.robot.repairs import repair_names

NAME = "anthropomorphic3"


def test_old_members_of_the_package_are_the_new_ones() -> None:
    for old, new in renamed.MEMBERS.items():
        with pytest.warns(DeprecationWarning, match=f"armgpi.{old}' is now called 'armgpi.{new}'"):
            assert getattr(armgpi, old) is getattr(armgpi, new)
        assert old not in dir(armgpi)


@pytest.mark.parametrize("module", ["arrays", "parameter"])
def test_old_modules_are_the_new_ones(module: str) -> None:
    sys.modules.pop(f"armgpi.{module}", None)
    with pytest.warns(DeprecationWarning, match=f"'armgpi.{module}' is now called 'armgpi.base.{module}'"):
        old = vars(import_module(f"armgpi.{module}"))
    new = {
        name: value for name, value in vars(import_module(f"armgpi.base.{module}")).items() if name[0] != "_"
    }
    assert new.items() <= old.items()


def test_the_old_method_makes_the_same_controller() -> None:
    robot = armgpi.Robot.load(NAME)
    with pytest.warns(DeprecationWarning, match="'GPI.auto'"):
        old = armgpi.GPI.untuned(robot, 1e-3, bits=16)
    new = armgpi.GPI.auto(robot, 1e-3, bits=16)
    np.testing.assert_array_equal(old.gains.nominal().omega_c, new.gains.nominal().omega_c)


@pytest.mark.parametrize("old", renamed.DRIVES)
def test_old_words_for_assumed_drives(old: str) -> None:
    robot, new = armgpi.Robot.load(NAME), renamed.DRIVES[old]
    with pytest.warns(DeprecationWarning, match=f"{old!r} is now called {new!r}"):
        found = armgpi.assume_drives(robot, old)
    assert found.drives == armgpi.assume_drives(robot, new).drives


def test_old_attributes_are_the_new_ones() -> None:
    unknown: Any = None
    bound = PathBound(unknown, np.zeros(1), 0.0, np.zeros(1), {}, 2.0, 3.0)
    estimate = Estimate("j", "mass", 1.0, 0.5, 2.0, 0.7, 1.1)
    outcome = Outcome("arm", 0, True, False, False, False, 0.1, 0.2, 0.3, 0.4)
    rows = {
        ("bears", "tolerated_torque"): bound,
        ("bears_force", "tolerated_force"): bound,
        ("learned", "data_share"): estimate,
        ("lost", "failed"): outcome,
    }
    for (old, new), thing in rows.items():
        with pytest.warns(DeprecationWarning, match=f"{old!r} is now called {new!r}"):
            assert getattr(thing, old) == getattr(thing, new)


def test_a_file_of_drives_with_old_sources_loads(tmp_path: Path) -> None:
    path, stiffness = tmp_path / "drives.yaml", {"value": 1e4, "low": 5e3, "high": 2e4}
    for old, new in renamed.SOURCES.items():
        path.write_text(yaml.safe_dump({"q1": {"stiffness": {**stiffness, "source": old}}}))
        with pytest.warns(DeprecationWarning, match=f"{old!r} is now called {new!r}"):
            drives = Drives.read(path)
        assert drives.sources("stiffness") == (new,)


@pytest.mark.parametrize("old", renamed.DRIVES)
def test_an_old_experiment_file_loads_as_the_new_one(old: str, tmp_path: Path) -> None:
    path = tmp_path / "experiment.yaml"
    texts = [
        f"robot: {{name: {NAME}, drives: {word}}}\ncontrollers: [{{type: {kind}}}]\n"
        for word, kind in ((old, "untuned"), (renamed.DRIVES[old], "gpi_auto"))
    ]
    path.write_text(texts[0])
    with pytest.warns(RenamedWarning) as warned:
        before = config.read(path).config
    said = " ".join(str(each.message) for each in warned)
    assert f"{old!r} is now called {renamed.DRIVES[old]!r}" in said
    assert "'untuned' is now called 'gpi_auto'" in said
    path.write_text(texts[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RenamedWarning)
        assert config.read(path).config == before
    assert before.robot.drives == renamed.DRIVES[old]


def test_old_kind_of_repair() -> None:
    with pytest.warns(DeprecationWarning, match="'assume-bodies'"):
        assert repair_names("suppose-bodies:arm") == {"assume-bodies:arm"}


def test_old_controller_of_a_certificate() -> None:
    robot = armgpi.Robot.load(NAME)
    with pytest.warns(DeprecationWarning, match="'gpi_auto'"):
        ask(robot, 1e-3, speed=0.2, radius=0.2, controller="untuned", torque=0.001, gains=None)


@pytest.mark.parametrize("old", renamed.DRIVES)
def test_the_command_line_takes_old_words_and_says_so(old: str, cli: Any) -> None:
    answer = cli("run", NAME, "--t-final", "0.01", "--controller", "untuned", "--drives", old)
    assert answer.code == 0
    assert f"warning: {old!r} is now called {renamed.DRIVES[old]!r}" in answer.err
    assert "'untuned' is now called 'gpi_auto'" in answer.err
