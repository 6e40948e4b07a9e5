"""The names a user writes after `armgpi.`: all there, told alike to people, programs and type checkers."""

from __future__ import annotations

import ast
import inspect
import pydoc
import re
import subprocess
import sys
from enum import EnumMeta
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import armgpi

SOURCE = Path(armgpi.__file__)
#: Each public name and its parameters. CONTRIBUTING.md says how one goes.
SNAPSHOT = Path(__file__).with_name("public_names.txt")


def parameters(name: str) -> list[str]:
    """Return the parameters of a public name; none of a module, an exception or an enumeration."""
    value = getattr(armgpi, name)
    exception = isinstance(value, type) and issubclass(value, Exception)
    return (
        []
        if exception or isinstance(value, EnumMeta) or not callable(value)
        else [*inspect.signature(value).parameters]
    )


def test_no_public_name_or_parameter_goes_without_a_warning_first() -> None:
    """A new name is added to the file by hand; an old one goes by the rule of CONTRIBUTING.md."""
    known = {
        name: words for name, *words in map(str.split, SNAPSHOT.read_text(encoding="utf-8").splitlines())
    }
    assert sorted(known) == dir(armgpi)
    assert not {name: gone for name, words in known.items() if (gone := set(words) - set(parameters(name)))}


@pytest.mark.parametrize("name", dir(armgpi))
def test_every_public_name_loads(name: str) -> None:
    value = getattr(armgpi, name)
    if name == "__version__":
        assert isinstance(value, str)
    elif not isinstance(value, ModuleType):
        assert value.__doc__
        assert value.__name__ == name
        assert value.__module__.startswith("armgpi.")


def test_what_type_checkers_see_is_what_is_loaded() -> None:
    tree = ast.parse(SOURCE.read_text(encoding="utf-8"))
    blocks = [node for node in tree.body if isinstance(node, ast.If)]
    (block,) = (node for node in blocks if ast.unparse(node.test) == "TYPE_CHECKING")
    seen = set()
    for statement in block.body:
        assert isinstance(statement, ast.ImportFrom)
        for alias in statement.names:
            # Only `import X as X` makes a name public for them.
            assert alias.asname == alias.name
            place = statement.module if alias.name in armgpi._HOME else f"armgpi.{alias.name}"
            seen.add((alias.name, place))
    loaded = {(name, f"armgpi.{home}") for name, home in armgpi._HOME.items()}
    assert seen == loaded | {(name, f"armgpi.{name}") for name in armgpi._MODULES}


@pytest.mark.parametrize("name", ["metrics", "plots", "robots", "health", "errors"])
def test_public_modules_can_be_imported_by_their_name(name: str) -> None:
    code = f"import armgpi.{name} as module, armgpi; assert module is armgpi.{name}; print(module.__name__)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    home = armgpi._MODULES[name]
    assert run.stdout.strip() == f"armgpi.{home}"


def test_public_names_are_sorted_unique_and_what_dir_lists() -> None:
    assert dir(armgpi) == sorted(set(armgpi._MODULES) | set(armgpi._HOME) | {"__version__"})


def test_no_name_hides_a_module_of_the_package() -> None:
    # `import armgpi.robot.robot` sets armgpi.robot.robot: a class of that name would then be replaced by it.
    # A folder that was renamed may still be there with what Python compiled in it.
    sources = {path.relative_to(SOURCE.parent) for path in SOURCE.parent.rglob("*.py")}
    modules = {Path(source.parts[0]).stem for source in sources}
    assert not modules & set(armgpi._HOME)


def test_a_name_that_does_not_exist_is_an_attribute_error_like_everywhere() -> None:
    with pytest.raises(AttributeError, match="module 'armgpi' has no attribute 'Robott'"):
        armgpi.Robott  # noqa: B018
    assert not hasattr(armgpi, "Robott")


def test_help_is_short_and_has_every_public_name() -> None:
    text = pydoc.render_doc(armgpi)
    assert len(text.splitlines()) < 120
    listed = set(re.findall(r"\w+", str(armgpi.__doc__)))
    assert set(dir(armgpi)) - {"__version__"} <= listed


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: armgpi.RobotWrapper, "use armgpi.Robot.from_pinocchio"),
        (lambda: armgpi.simulat, "did you mean 'simulate'"),
        (lambda: armgpi.Robot.load("anthropomorphic3").rnea, r"use inverse_dynamics\(q, v, a\)"),
        (lambda: armgpi.Robot.load("anthropomorphic3").fkine, "use frame_pose"),
        (lambda: armgpi.Robot.load("anthropomorphic3").gravty, "did you mean 'gravity'"),
        (lambda: armgpi.Robot.load("anthropomorphic3").dof, "use n"),
        (lambda: armgpi.metrics.rmse, r"use armgpi.metrics.rms\(rollout\)"),
        (lambda: armgpi.metrics.itea, "did you mean 'itae'"),
        (lambda: armgpi.plots.plot, r"use armgpi.plots.overview\(rollout\)"),
        (lambda: armgpi.plots.torqes, "did you mean 'torques'"),
        (lambda: armgpi.load_urdf, r"use armgpi.Robot.load\(path\)"),
    ],
)
def test_names_of_other_libraries_and_slips_get_the_name_that_exists(make: Any, said: str) -> None:
    with pytest.raises(AttributeError, match=said):
        make()


def test_a_robot_that_is_made_of_a_name_alone_says_what_loads_it() -> None:
    with pytest.raises(TypeError, match=r"a robot is loaded by armgpi.Robot.load\('ur5'\)"):
        armgpi.Robot("ur5")  # type: ignore[call-arg]


def test_a_wrong_keyword_gets_the_nearest_one() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    kinds: list[tuple[Any, tuple[Any, ...], str, str]] = [
        (armgpi.PIDInversion, (robot, 1e-3), "kpp", "kp"),
        (armgpi.Encoder, (armgpi.RigidBodyPlant(robot),), "bit", "bits"),
        (armgpi.Bezier, (), "strt", "start"),
    ]
    for kind, arguments, wrong, right in kinds:
        with pytest.raises(TypeError, match=f"{wrong!r}; did you mean {right!r}"):
            kind(*arguments, **{wrong: 1.0})


def test_windows_is_refused_in_a_line_that_says_what_to_do() -> None:
    code = "import sys; sys.platform = 'win32'; import armgpi"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr.endswith("on Windows use it inside WSL 2 (wsl --install)\n")


def test_import_armgpi_loads_nothing_heavy() -> None:
    heavy = ("pinocchio", "xarray", "numpy", "scipy", "matplotlib", "pydantic", "typer")
    code = f"import sys, armgpi; print([name for name in {heavy} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_reading_urdfs_loads_no_pinocchio() -> None:
    code = "import sys, armgpi.robot.urdf; print('pinocchio' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.mark.parametrize("name", sorted(armgpi._MODULES))
def test_dir_of_a_public_module_has_no_imports(name: str) -> None:
    module = getattr(armgpi, name)
    assert "annotations" not in dir(module)
    for member in dir(module):
        value = getattr(module, member)
        home = getattr(value, "__module__", None)
        assert not isinstance(value, ModuleType)
        assert home is None or home.startswith("armgpi."), member


def test_a_module_that_lacks_a_package_says_what_to_install() -> None:
    """In a process in which no extra is installed, every module loads or raises our error with its line."""
    code = """
import importlib, pkgutil, sys
EXTRAS = {"matplotlib", "casadi", "trimesh", "collada", "mujoco", "cma", "optuna", "sympy", "clarabel",
          "xacrodoc", "ziglang", "gymnasium", "mcap", "mcap_ros2", "rerun", "yourdfpy", "meshcat"}
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
import armgpi
from armgpi.errors import MissingPackage
for module in pkgutil.walk_packages(armgpi.__path__, "armgpi.", onerror=lambda name: None):
    if not module.name.endswith("__main__"):
        try:
            importlib.import_module(module.name)
        except MissingPackage as error:
            print(module.name, error)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    refused = dict(line.split(" ", 1) for line in run.stdout.splitlines())
    some = {"armgpi.viewing.plots", "armgpi.codegen.trace", "armgpi.hardware.export.code", "armgpi.envs"}
    assert some <= set(refused)
    assert all("pip install " in message for message in refused.values())
