"""Names and keywords that do not exist are answered with what to write, also those of other libraries."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import pytest

import armgpi
from armgpi.base import hints

ARM = armgpi.Robot.load("anthropomorphic3")
LAW: Any = armgpi.GPI(ARM, 1e-3)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("omega", "use gains"), ("gain", "use gains"), ("compute_torque", "use init(measurement")],
)
def test_an_attribute_that_a_controller_has_not_gets_a_hint(name: str, hint: str) -> None:
    with pytest.raises(AttributeError) as caught:
        getattr(LAW, name)
    assert str(caught.value).startswith(f"'GPI' object has no attribute {name!r}; {hint}")
    assert caught.value.obj is None  # else Python would add a second hint


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("t", 'use rollout["time"]'),
        ("qd", "use v"),
        ("torques", "use tau"),
        ("itae", "use armgpi.metrics.itae(rollout)"),
        ("q_reff", "did you mean 'q_ref'?"),
    ],
)
def test_a_variable_that_a_rollout_has_not_gets_a_hint(name: str, hint: str, tmp_path: Path) -> None:
    rollout = armgpi.simulate(armgpi.RigidBodyPlant(ARM), LAW, armgpi.Hold(ARM.middle()), 0.01)
    armgpi.save(rollout, tmp_path / "rollout.nc")
    loaded = armgpi.load(tmp_path / "rollout.nc")
    for each in (rollout, rollout.isel(time=0), loaded, copy.deepcopy(rollout)):
        with pytest.raises(AttributeError) as caught:
            getattr(each, name)
        assert str(caught.value).startswith(f"a rollout has no attribute {name!r}; {hint}")
        assert caught.value.obj is None
        with pytest.raises(KeyError) as missing:
            each[name]
        assert str(missing.value).startswith(f"a rollout has no variable {name!r}; {hint}")
        with pytest.raises(KeyError) as several:
            each[["q", name]]
        assert str(several.value) == str(missing.value)
    with pytest.raises(KeyError):
        rollout[("q", 1)]  # no list of names: as xarray says it
    assert loaded.identical(rollout)
    assert not hasattr(rollout, "_repr_png_")


def test_metrics_that_hints_name_are_there() -> None:
    for text in hints.ROLLOUT.values():
        if text.startswith("armgpi.metrics."):
            assert callable(getattr(armgpi.metrics, text.removeprefix("armgpi.metrics.").split("(")[0]))


def test_what_asks_for_attributes_is_answered_as_ever() -> None:
    assert not hasattr(LAW, "omega")
    assert getattr(LAW, "omega", 3.0) == 3.0
    assert copy.copy(LAW).dt == LAW.dt
    assert str(hints.MissingAttribute(LAW, "xyzzy", {})) == "'GPI' object has no attribute 'xyzzy'"


def test_a_missing_attribute_is_reported_from_another_process() -> None:
    error = hints.MissingAttribute(LAW, "gain", {})
    assert str(pickle.loads(pickle.dumps(error))) == str(copy.copy(error)) == str(error)


def call(name: str, *args: Any, **kwargs: Any) -> None:
    function: Any = armgpi
    for part in name.split("."):
        function = getattr(function, part)
    function(*args, **kwargs)


@pytest.mark.parametrize(
    ("name", "keyword", "hint"),
    [
        ("simulate", "tfinal", "did you mean 't_final'?"),
        ("simulate", "tf", "did you mean 't_final'?"),
        ("Robot.load", "locks", "did you mean 'lock'?"),
        ("Robot.load", "urdf", "did you mean 'path_or_name'?"),
        ("GPI", "bandwidth", "did you mean 'gains', as in gains=armgpi.FixedGains(20.0)?"),
        ("GPI", "Ts", "did you mean 'dt'?"),
        ("GPI.auto", "bit", "did you mean 'bits'?"),
        ("certify", "payloads", "did you mean 'payload'?"),
        ("validate", "robots", "did you mean 'robot'?"),
        ("identify", "robots", "did you mean 'robot'?"),
        ("export_controller", "folders", "did you mean 'folder'?"),
        ("inverse_kinematics", "xyzzy", "it has robot, frame, position"),
    ],
)
def test_a_wrong_keyword_gets_the_nearest_one(name: str, keyword: str, hint: str) -> None:
    with pytest.raises(TypeError) as caught:
        call(name, ARM, 1e-3, **{keyword: 1.0})
    assert str(caught.value).startswith(f"{name}() got an unexpected keyword argument {keyword!r}; {hint}")


def test_a_certificate_without_a_speed_says_what_it_lacks() -> None:
    with pytest.raises(TypeError, match=r"certify\(\) requires speed=, the largest speed"):
        armgpi.certify(ARM, payload=(0.0, 1.0))


def test_every_keyword_of_other_libraries_leads_to_one_that_is_not_itself() -> None:
    for name, here in hints.KEYWORDS.items():
        assert here
        assert name not in here


def test_plants_references_and_gains_have_hints_as_well() -> None:
    plant: Any = armgpi.Encoder(armgpi.RigidBodyPlant(ARM), bits=16)
    with pytest.raises(
        AttributeError, match=r"'Encoder' object has no attribute 'bit'; did you mean 'bits'\?"
    ):
        _ = plant.bit
    gains: Any = armgpi.FixedGains(20.0)
    with pytest.raises(AttributeError, match=r"did you mean 'omega_c'\?"):
        _ = gains.omega


def test_a_property_that_lacks_something_says_what_it_lacks() -> None:
    class Broken(armgpi.FixedGains):
        @property
        def broken(self) -> float:
            return self.nothing_of_that_name  # type: ignore[attr-defined]

    with pytest.raises(AttributeError, match="has no attribute 'nothing_of_that_name'"):
        _ = Broken(20.0).broken
