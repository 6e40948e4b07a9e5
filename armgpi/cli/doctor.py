"""The command that checks the installation."""

from __future__ import annotations

import json
import os
import platform
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from armgpi.base.version import ADDRESS
from armgpi.cli.parsing import FAILED
from armgpi.cli.terminal import say

#: Extra -> the packages that it brings, by distribution and module.
_EXTRAS = {
    "viz": (("matplotlib", "matplotlib"), ("trimesh", "trimesh"), ("pycollada", "collada")),
    "check": (("yourdfpy", "yourdfpy"),),
    "mujoco": (("mujoco", "mujoco"),),
    "derive": (("sympy", "sympy"),),
    "compiled": (("casadi", "casadi"),),
    "tune": (("cma", "cma"),),
    "optuna": (("optuna", "optuna"),),
    "cluster": (("dask", "dask"), ("distributed", "distributed")),
    "certify": (("clarabel", "clarabel"),),
    "play": (("ziglang", "ziglang"),),
    "envs": (("gymnasium", "gymnasium"),),
    "mcap": (("mcap", "mcap"), ("mcap-ros2-support", "mcap_ros2")),
    "xacro": (("xacrodoc", "xacrodoc"),),
    "rerun": (("rerun-sdk", "rerun"),),
}
_NEEDED = ("numpy", "scipy", "xarray", "h5netcdf", "h5py", "typer", "rich", "PyYAML")
_OLDEST_PIN, _OLDEST_DATA = 4, 6


class Check(NamedTuple):
    """One line of the diagnosis.

    Attributes:
        level: "ok", "info" or "error".
        what: what was checked.
        found: what was found.
        repair: what to do; empty when nothing has to be done.
    """

    level: str
    what: str
    found: str
    repair: str = ""


def doctor(as_json: bool = False) -> None:
    """Check the installation: which Pinocchio is imported, which packages are missing, what may conflict."""
    checks = diagnose()
    if as_json:
        say(json.dumps([check._asdict() for check in checks]))
    else:
        colours = {"ok": None, "info": None, "error": "red"}
        for check in checks:
            repair = f" -> {check.repair}" if check.repair else ""
            say(f"{check.level:5} {check.what}: {check.found}{repair}", fg=colours[check.level])
        if ADDRESS:
            say(f"problems are reported at {ADDRESS}, with these lines")
    if any(check.level == "error" for check in checks):
        sys.exit(FAILED)


def diagnose() -> list[Check]:
    """Return what the installation is."""
    import armgpi

    checks = [
        Check("ok", "armgpi", f"{armgpi.__version__} in {Path(armgpi.__file__).parent}"),
        Check("ok", "Python", f"{platform.python_version()} at {sys.executable} ({platform.platform()})"),
        _pinocchio(),
        *(
            Check("ok", name, found) if found else Check("error", name, "is missing", f"pip install {name}")
            for name, found in zip(_NEEDED, map(_version, _NEEDED), strict=True)
        ),
        _example_robot_data(),
        *(_extra(name, packages) for name, packages in _EXTRAS.items()),
        _compiler(),
        _check_descriptions(),
        _shadows(),
    ]
    ros = [key for key in ("ROS_DISTRO", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH") if os.environ.get(key)]
    if ros:
        values = ", ".join(f"{key}={os.environ[key]}" for key in ros)
        checks.append(Check("info", "ROS", values, "its PYTHONPATH may bring another Pinocchio"))
    threads = os.environ.get("OMP_NUM_THREADS", "not set: all cores")
    checks.append(Check("ok", "threads", f"OMP_NUM_THREADS {threads}; {os.cpu_count()} cores"))
    return checks


def _pinocchio() -> Check:
    """Return which Pinocchio is imported, and try it."""
    try:
        import pinocchio
    except ImportError as error:
        return Check(
            "error", "pinocchio", f"does not import: {error}", "pip install pin, and clear PYTHONPATH"
        )
    place = getattr(pinocchio, "__file__", None) or "nowhere"
    if not hasattr(pinocchio, "buildModelFromXML"):
        # PyPI's `pinocchio` is a plug-in for nose.
        repair = "pip uninstall pinocchio; pip install pin"
        return Check("error", "pinocchio", f"{place} is another package of that name", repair)
    found = f"{pinocchio.__version__} in {Path(place).parent}"
    if _major(pinocchio.__version__) < _OLDEST_PIN:
        return Check("error", "pinocchio", found, f"pip install 'pin>={_OLDEST_PIN}'")
    wheel = _version("pin")
    if wheel is None:
        return Check("info", "pinocchio", found, "it is not the wheel `pin`; armgpi is tested with that")
    if not pinocchio.__version__.startswith(wheel):
        repair = "another installation comes first on the path; clear PYTHONPATH"
        return Check("error", "pinocchio", f"{found}, but pin {wheel} is installed", repair)
    try:
        from armgpi import Robot

        Robot.load("anthropomorphic3")
    except Exception as error:  # whatever a broken installation does
        return Check("error", "pinocchio", f"{found} fails: {error}", "install pin and numpy anew")
    return Check("ok", "pinocchio", f"{found}; loads our arm")


def _compiler() -> Check:
    """Return which C compiler makes generated code."""
    from armgpi.codegen.build import compiler
    from armgpi.errors import BackendError

    try:
        found = compiler()
    except BackendError as error:
        return Check("info", "C compiler", str(error), "apt install gcc, or xcode-select --install")
    return Check("ok", "C compiler", found.version.splitlines()[0] if found.version else found.command[0])


def _extra(name: str, packages: tuple[tuple[str, str], ...]) -> Check:
    """Return which packages of an extra are there."""
    missing = [package for package, module in packages if find_spec(module) is None]
    if missing:
        return Check("info", f"extra {name}", f"no {', '.join(missing)}", f"pip install {' '.join(missing)}")
    return Check("ok", f"extra {name}", ", ".join(f"{p} {_version(p) or '?'}" for p, _ in packages))


def _example_robot_data() -> Check:
    """Return which example-robot-data is found, and how many robots of it."""
    from armgpi.robot import robots

    version, count = _version("example-robot-data"), len(robots.names())
    folder = robots.example_folder()
    install = "pip install example-robot-data"
    if folder is None:
        return Check("info", "example-robot-data", f"not found; {count} robots by name", install)
    found = f"{version or 'unknown version'} in {folder}; {count} robots by name"
    if version is not None and _major(version) < _OLDEST_DATA:
        return Check("info", "example-robot-data", found, f"some robots may be missing: {install}")
    return Check("ok", "example-robot-data", found)


def _check_descriptions() -> Check:
    """Return whether robot_descriptions is there."""
    from armgpi.robot import robots

    count = len(robots.description_names())
    if not count:
        return Check("ok", "robot_descriptions", "not installed (not needed)")
    version = _version("robot_descriptions")
    return Check("ok", "robot_descriptions", f"{version}; {count} names, fetched at first use")


def _shadows() -> Check:
    """Return which of our packages PYTHONPATH puts before the installed ones."""
    entries = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    modules = ("pinocchio", "numpy", "scipy", "xarray", "eigenpy", "yourdfpy", "hppfcl", "coal")
    hidden = [
        f"{module} in {entry}"
        for entry in entries
        for module in modules
        if (Path(entry) / module).is_dir() or (Path(entry) / f"{module}.py").is_file()
    ]
    if hidden:
        repair = "start without it: env -u PYTHONPATH armgpi ..."
        return Check("error", "PYTHONPATH", f"hides installed packages by {', '.join(hidden)}", repair)
    return Check("ok", "PYTHONPATH", os.pathsep.join(entries) or "not set")


def _version(distribution: str) -> str | None:
    """Return the version of an installed distribution."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def _major(version: str) -> int:
    """Return the first number of a version."""
    head = version.split(".")[0]
    return int(head) if head.isdigit() else 0
