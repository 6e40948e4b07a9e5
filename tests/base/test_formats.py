"""Files that armgpi writes and reads again: of another format, or of none, each is refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml

import armgpi
from armgpi import config
from armgpi.certification import check_certificate
from armgpi.hardware.realtime import stages
from armgpi.loop import log
from armgpi.robot import identified
from armgpi.studies import study

NETCDF = {"armgpi_format": armgpi.load, "armgpi_weights": lambda path: armgpi.load_weights(path, _robot())}
TEXT: dict[str, Callable[[Path], Any]] = {
    "certificate.json": armgpi.Certificate.load,
    "identification.json": identified.read_data,
    "study.json": lambda path: study.read_identity(path.parent),
    "stages.yaml": lambda path: stages.read(path.parent),
}


def _robot() -> armgpi.Robot:
    return armgpi.Robot.load("anthropomorphic3")


def refused(read: Callable[[Path], Any], path: Path) -> str:
    """Return the one line in which a file is refused, which names it."""
    with pytest.raises(armgpi.ArmgpiError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", TEXT)
@pytest.mark.parametrize(("format", "said"), [({"format": 999}, "is of format 999"), ({}, "is of no format")])
def test_a_text_of_another_format_is_refused(name: str, format: Any, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(json.dumps(format))
    assert said in refused(TEXT[name], tmp_path / name)


@pytest.mark.parametrize("attribute", NETCDF)
def test_a_netcdf_file_of_another_format_is_refused(attribute: str, tmp_path: Path) -> None:
    path = tmp_path / "file.nc"
    xr.Dataset({"q": ("time", np.zeros(3))}, attrs={attribute: 999}).to_netcdf(path, engine="h5netcdf")
    assert "is of format 999" in refused(NETCDF[attribute], path)


def test_a_log_of_another_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file.armlog"
    path.write_bytes(log.MAGIC + np.array([999, 0], dtype="<u4").tobytes())
    assert "is of format 999" in refused(log.read, path)


def test_a_certificate_of_another_format_is_none_to_the_checker() -> None:
    assert "format" in check_certificate.check({"format": 999})[0]


def test_an_experiment_file_of_another_format_says_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    path.write_text("format: 999\nunknown: 1\n")
    assert "is of format 999" in refused(config.read, path)


def test_an_experiment_file_without_a_format_is_of_the_first_and_is_written_with_it() -> None:
    read = config.parse("robot: {name: anthropomorphic3}", "file.yaml").config
    for full in (True, False):
        assert next(iter(yaml.safe_load(config.dump(read, full)).items())) == ("format", 1)
