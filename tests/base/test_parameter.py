"""A parameter declared once: its checks, what cannot change, and that every reader finds the same."""

from __future__ import annotations

import dataclasses
import inspect
import os
import subprocess
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import armgpi
from armgpi import GPI, PIDInversion, RigidBodyPlant, Robot, config
from armgpi.base.parameter import (
    REQUIRED,
    PerJoint,
    _listed_attributes,
    again,
    parameter,
    parameters,
    with_parameters,
)
from armgpi.cli import declared
from armgpi.config import schema
from armgpi.config.section import union
from armgpi.control.controller import Controller
from armgpi.errors import ArmgpiError, ArrayError, ConfigError, ParameterError
from armgpi.plants.arm import Arm
from armgpi.plants.loads import Load
from armgpi.plants.plant import StatefulWrapper, Wrapper
from armgpi.references.paths import Path as ToolPath
from armgpi.registry import classes_of, subclasses

ARM = Robot.load("anthropomorphic3")
ROOT = Path(__file__).parents[2]
PARTS: list[Any] = [
    cls
    for base in (Controller, Arm, Wrapper, Load, ToolPath)
    for cls in subclasses(base)
    if cls.__module__.startswith("armgpi.") and not inspect.isabstract(cls)
]


@with_parameters
class Everything(armgpi.Controller):
    """One parameter of each kind that a user may declare."""

    gain: PerJoint = parameter("a gain", unit="1/s", default=2.0, least=0.0, above=True, per_joint=True)
    count: int = parameter("a count", kind="integer", default=3, least=1, most=9)
    share: float = parameter("a share", default=0.5, least=0.0, most=1.0, below=True)
    mode: str = parameter("a mode", kind="choice", default="a", choices=("a", "b"))
    wanted: bool = parameter("whether", kind="flag", default=False)
    axis: Any = parameter("an axis", kind="vector", default=(0.0, 0.0, 1.0))
    limit: float = parameter("a limit", default=np.inf, unlimited="none")

    def init(self, measurement: Any, target: Any) -> None:
        """Return no state."""

    def step(self, measurement: Any, target: Any, state: None) -> armgpi.ControlStep:
        """Return no torque."""
        return armgpi.ControlStep(np.zeros_like(measurement.q), None)


@with_parameters
class Twice(Everything):
    """A controller that declares two parameters again."""

    gain: PerJoint = again(default=5.0, unit="1/ms")
    mode: str = again("another mode", default="b", choices=("b", "c"))


def test_what_is_declared_again_is_as_before_but_for_what_is_said() -> None:
    before, after = parameters(Everything), parameters(Twice)
    assert list(before) == list(after)
    gain = before["gain"]
    assert after["gain"] == dataclasses.replace(gain, default=5.0, unit="1/ms")
    assert (after["mode"].text, after["mode"].default, after["mode"].kind) == ("another mode", "b", "choice")
    assert Twice(ARM, 1e-3).describe()["gain"] == [5.0] * ARM.n
    with pytest.raises(ParameterError, match="one of b, c"):
        Twice(ARM, 1e-3, mode="a")


# Checks.


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"gain": 0.0}, ArrayError, r"gain: expected positive \[1/s\] values, got 0 for joint 'q1'"),
        ({"gain": [1.0, -2.0, 1.0]}, ArrayError, "-2 for joint 'q2'"),
        ({"gain": [1.0, 2.0]}, ArrayError, "shape"),
        ({"gain": np.nan}, ArrayError, "finite"),
        ({"gain": None}, ArrayError, "gain"),
        ({"count": 0}, ParameterError, "count must be a whole number, from 1 to 9, got 0"),
        ({"count": 2.0}, ParameterError, "count"),
        ({"count": True}, ParameterError, "count"),
        ({"share": 1.0}, ParameterError, r"share must be in \[0, 1\), got 1.0"),
        ({"share": "half"}, ParameterError, "share"),
        ({"share": np.inf}, ParameterError, "share"),
        ({"mode": "c"}, ParameterError, "mode must be one of a, b, got 'c'"),
        ({"wanted": 1}, ParameterError, "wanted must be True or False"),
        ({"axis": [1.0, 2.0]}, ArrayError, "axis: expected three numbers"),
        ({"limit": -np.inf}, ParameterError, "limit"),
    ],
)
def test_what_is_not_as_declared_is_refused_by_name(
    options: dict[str, Any], error: type[ArmgpiError], message: str
) -> None:
    with pytest.raises(error, match=message):
        Everything(ARM, 1e-3, **options)


def test_per_joint_values_become_arrays_over_the_joints() -> None:
    made = Everything(ARM, 1e-3, gain=[1, 2, 3])
    np.testing.assert_array_equal(made.gain, [1.0, 2.0, 3.0])
    assert made.gain.dtype == np.float64
    assert made.batch is None
    assert Everything(ARM, 1e-3, gain=np.ones((4, 3))).batch == 4
    assert made.describe() == {
        "controller": "Everything",
        "dt": 1e-3,
        "effort": ARM.limits.effort.tolist(),
        "gain": [1.0, 2.0, 3.0],
        "count": 3,
        "share": 0.5,
        "mode": "a",
        "wanted": False,
        "axis": [0.0, 0.0, 1.0],
        "limit": np.inf,
        "robot": ARM.provenance,
    }


@pytest.mark.parametrize("name", ["kp", "dt", "robot", "effort"])
def test_a_parameter_cannot_be_set_again(name: str) -> None:
    made = PIDInversion(ARM, 1e-3)
    with pytest.raises(FrozenInstanceError, match=name):
        setattr(made, name, 1.0)


def test_a_controller_with_an_init_of_its_own_needs_no_declarations() -> None:
    class Own(armgpi.Controller):
        def __init__(self, robot: Robot, dt: float, gain: float) -> None:
            super().__init__(robot, dt, 5.0)
            self.gain = gain

        def init(self, measurement: Any, target: Any) -> None: ...
        def step(self, measurement: Any, target: Any, state: None) -> Any: ...

    made = Own(ARM, 1e-3, 2.0)
    assert (made.gain, made.dt, made.effort.tolist()) == (2.0, 1e-3, [5.0] * 3)
    made.gain = 3.0
    with pytest.raises(FrozenInstanceError):
        made.dt = 2e-3


# Declarations.


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
def test_a_declaration_says_what_it_has_to(cls: type) -> None:
    for name, each in parameters(cls).items():
        assert each.text, name
        assert each.text[-1] != "."
        assert each.least <= each.most
        assert each.kind != "choice" or each.choices
        for ends in (each.search, each.slider):
            assert ends is None or each.inside(np.array(ends, dtype=float)).all(), name
        if each.default is not REQUIRED and each.default is not None and each.kind not in ("box", "vector"):
            each.check_value(each.default)


def test_options_written_down_are_those_of_the_classes(tmp_path: Path) -> None:
    wanted = {
        name: next(each for each in parameters(cls).values() if each.in_file)
        for name, cls in classes_of(Wrapper).items()
        if cls.__module__.startswith("armgpi.")  # no class of another test
        and sum(each.in_file for each in parameters(cls).values()) == 1
    }
    owners: dict[str, list[str]] = {}
    for cls in classes_of(Arm).values():
        kinds = ("number", "integer", "choice", "text")
        wanted |= {n: each for n, each in parameters(cls).items() if each.in_file and each.kind in kinds}
    for kind, made in schema.KINDS.items():
        for name, each in made.parameters.items():
            tables = each.group and not any(x.kind == "number" for x in parameters(each.group).values())
            if each.kind in (*kinds, "group") and not tables:
                owners.setdefault(each.key or name, []).append(kind)
                wanted[each.key or name] = each
    found = {option.key.removeprefix("plant."): option for option in declared.options()}
    assert set(found) == set(wanted)
    for key, each in wanted.items():
        assert list(found[key].owners) == owners.get(key, [])
        assert found[key].kind == each.kind
        assert f"{each.text[1:]}{f' [{each.unit}]' if each.unit else ''}" in found[key].help
        default = each.chosen or each.none if found[key].owners else ""
        assert all(word in found[key].help for word in (*each.choices, default))
    # A fresh process: this one has classes of other tests.
    anew = tmp_path / "declared.json"
    subprocess.run([sys.executable, str(ROOT / "tools" / "options.py"), str(anew)], check=True)
    kept = Path(declared.__file__).with_name("declared.json")
    assert anew.read_text() == kept.read_text(), "run make format"


# A new controller and a new sensor are one new module.

PLUGIN = '''
"""A spring to the target, and a sensor that is off by a constant."""

from typing import ClassVar

import armgpi
from armgpi.base.parameter import PerJoint, parameter, with_parameters


@with_parameters
class Spring(armgpi.Controller):
    """tau = k (q* - q)."""

    config_name: ClassVar = "spring"
    stiffness: PerJoint = parameter(
        "stiffness of the spring", unit="N m/rad", default=5.0, least=0.0, per_joint=True
    )

    def init(self, measurement, target):
        return None

    def step(self, measurement, target, state):
        return armgpi.ControlStep(self.limited(self.stiffness * (target.q - measurement.q)), None)


@with_parameters
class Biased(armgpi.Wrapper):
    """Positions that are off."""

    config_name: ClassVar = "bias"
    order: ClassVar = 35.0
    offset: PerJoint = parameter("constant error of measured positions", unit="rad or m", per_joint=True)

    def measure(self, state):
        q, v = self.plant.measure(state)
        return armgpi.FullState(q + self.offset, v)
'''


def test_a_plugin_is_known_to_files_options_help_and_provenance(tmp_path: Path) -> None:
    (tmp_path / "springs.py").write_text(PLUGIN)
    info = tmp_path / "springs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: springs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[armgpi.plugins]\nsprings = springs\n")
    path = os.pathsep.join([str(tmp_path), str(Path(armgpi.__file__).parents[1])])

    def run(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "armgpi.cli", *arguments],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": path, "COLUMNS": "80"},
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    helped = run("run", "--help-all")
    assert "--stiffness" in helped
    assert "--bias" in helped
    out = tmp_path / "out"
    run(
        *("run", "anthropomorphic3", "--controller", "spring", "--stiffness", "q2=7", "--bias", "1e-3"),
        *("--t-final", "0.02", "--backend", "numpy", "--out", str(out)),
    )
    written = (out / "experiment.yaml").read_text()
    assert "type: spring" in written
    assert "bias: 0.001" in written
    run(
        "run",
        "--config",
        str(out / "experiment.yaml"),
        "--backend",
        "numpy",
        "--out",
        str(tmp_path / "again"),
    )
    assert (tmp_path / "again" / "experiment.yaml").read_text() == written
    (rollout, again) = (armgpi.load(folder / "rollout.nc") for folder in (out, tmp_path / "again"))
    assert rollout.attrs["provenance"] == again.attrs["provenance"]
    assert '"stiffness": [5.0, 7.0, 5.0]' in rollout.attrs["provenance"]
    assert '"offset": [0.001, 0.001, 0.001]' in rollout.attrs["provenance"]


def test_a_name_belongs_to_one_class() -> None:
    class First(Load):
        config_name: ClassVar[str | None] = "step"

        def torque(self, t: Any) -> Any: ...

    try:
        with pytest.raises(ConfigError, match="config_name 'step' is that of"):
            classes_of(Load)
    finally:
        First.config_name = None


def test_a_class_whose_parameters_nobody_made_is_named() -> None:
    class Bare(Load):
        config_name: ClassVar[str | None] = "bare"
        size: float = parameter("size")

        def torque(self, t: Any) -> Any: ...

    try:
        with pytest.raises(ConfigError, match=r"Bare: declares parameters, but has no @with_parameters"):
            classes_of(Load)
    finally:
        Bare.config_name = None


def test_a_key_belongs_to_one_declaration(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="plant: coulomb: is taken already"):
        union("plant", {"coulomb": 1}, {"viscous": 2}, {"coulomb": 3})

    @with_parameters
    class Late(PIDInversion):
        delay: float = parameter("what it takes for the delay", default=0.0)

    monkeypatch.setitem(schema.KINDS, "late", schema.Kind(Late))
    owners = {each.flag: each.owners for each in declared.read_classes().options if "delay" in each.flag}
    assert owners == {"--delay": (), "--controller-delay": ("late",)}


def test_a_class_that_comes_from_a_law_does_not_take_over_its_names() -> None:
    @with_parameters
    class Mine(GPI):
        pass

    assert Mine.__mro__[1] is GPI
    assert {kind.law for kind in schema._kinds().values()} >= {GPI, PIDInversion}
    assert Mine not in {kind.law for kind in schema._kinds().values()}


# Wrappers with a state of their own.


def test_a_wrapper_with_a_state_says_how_it_begins_and_goes_on() -> None:
    class Odometer(StatefulWrapper):
        def start(self, plant: Any, q: Any) -> Any:
            return np.zeros_like(q)

        def follow(self, plant: Any, own: Any, dt: float) -> Any:
            return own + dt * np.abs(self.plant.true_state(plant).v)

    plant = Odometer(armgpi.Encoder(RigidBodyPlant(ARM)))
    state = plant.init(np.zeros(3), np.ones(3))
    for _ in range(10):
        state = plant.step(np.zeros(3), state, 1e-3)
    assert plant.true_state(state).k == 10
    assert (state.own > 0.0).all()
    np.testing.assert_array_equal(plant.measure(state).q, plant.plant.measure(state.plant).q)


def test_a_controller_made_of_a_file_is_the_one_made_in_python() -> None:
    text = "robot: {name: anthropomorphic3}\ncontrollers: [{type: gpi, omega: {q2: 10}, p: {q1: 5}}]"
    made = config.build(*config.parse(text, "file.yaml")).controllers["gpi"]
    omega = armgpi.default_omega(1e-3)
    own = GPI(ARM, 1e-3, armgpi.FixedGains([omega, 10.0, omega], p_c=[5.0, 10.0, omega]))
    assert made.describe() == own.describe()


def test_attributes_of_a_docstring_are_their_words_without_shapes_and_remarks() -> None:
    text = """A class.

    Attributes:
        gain: of the position error [1/s^2], shape (n,) or (batch, n).
        damping: of the velocity error [1/s], likewise.
        limit: largest torque [N m]; infinite where there
            is none.
        mode: what it does,
            in words.
        name: of the arm

    Returns:
        other: nothing.
    """
    assert _listed_attributes(text) == {
        "gain": "of the position error [1/s^2]",
        "damping": "of the velocity error [1/s]",
        "limit": "largest torque [N m]",
        "mode": "what it does, in words",
        "name": "of the arm",
    }
    assert _listed_attributes("A class.") == {}
