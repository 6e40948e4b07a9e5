"""What a user gives as a model, made into functions that can be called.

A model is a Python file or module with functions or a class, a file of SymPy expressions, an object, a
mapping of functions, or the name of the paper's arm. Whatever it is, the result is a :class:`Functions`:
functions of the known names. Everything here runs in the
worker (:mod:`armgpi.validation.worker`), because reading a file of Python runs it.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import io
import json
import math
import sys
import tokenize
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.validation import expressions, forms
from armgpi.validation.conventions import SHORT, Convention, near_function
from armgpi.validation.graph import Program, is_drawn, joint_of, states_of
from armgpi.validation.wrapping import what_it_has

#: Function -> names of its arguments.
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "mass_matrix": ("q",),
    "coriolis_matrix": ("q", "v"),
    "coriolis_torque": ("q", "v"),
    "gravity": ("q",),
    "inverse_dynamics": ("q", "v", "a"),
    "forward_dynamics": ("q", "v", "tau"),
    "kinetic_energy": ("q", "v"),
    "potential_energy": ("q",),
    "forward_kinematics": ("q",),
    "jacobian": ("q",),
}
#: Of these what a model needs for its own use: helpers of the same names may take other arguments.
_KINEMATICS = ("forward_kinematics", "jacobian")
#: Names of a Coriolis function that do not say whether it is the matrix or its torque.
_EITHER = tuple(mine for mine, name in SHORT.items() if name == "coriolis_matrix")
#: Numbers of joints with which a Coriolis function of a model without a robot is tried, at most.
_MOST_TRIED = 8
#: Names of the paper's arm as a model.
PAPER = ("paper", "paper-arm", "paper_arm")
#: Files of bare expressions, read with SymPy's names and the symbols known.
SYMPY_SUFFIXES = (".sympy", ".txt")
#: Notebooks: their cells of code, one after the other, are the source.
NOTEBOOK = ".ipynb"
_SUFFIXES = (".py", NOTEBOOK, *SYMPY_SUFFIXES)
#: Largest size of a model's file [bytes].
_MOST_BYTES = 16 * 1024 * 1024
#: How functions of MATLAB become a model.
_MATLAB = (
    "; of MATLAB, write the symbolic expressions with char() into a .sympy file (^ becomes **), "
    "or call the functions from Python through matlab.engine or oct2py"
)
_NOWHERE = "there is no such file or module (built in is: paper)"
#: Where a module keeps which of its names are short ones made long.
ALIASES = "__armgpi_aliases__"
#: What functions of a state call their first argument.
POSITIONS = ("q", "theta", "th", "x", "pos", "angles", "state")
#: A model that cannot be used; the text says why.
Unusable = expressions.Unusable


class States(NamedTuple):
    """States at which models are compared, arrays of shape (N, n).

    Attributes:
        q: positions [rad or m].
        v: velocities [rad/s or m/s].
        a: accelerations [rad/s^2 or m/s^2].
        tau: torques [N m or N].
    """

    q: Array
    v: Array
    a: Array
    tau: Array

    def first(self, rows: int) -> States:
        """Return the first so many of them."""
        return States(*(x[:rows] for x in self))


class Origin(NamedTuple):
    """The file that a model was read from.

    Attributes:
        path: its name.
        source: its text.
        module: what running it gave.
        again: reads the functions out of the module once more.
    """

    path: str
    source: str
    module: ModuleType
    again: Callable[[], Functions]


class Functions:
    """A model's functions.

    Attributes:
        calls: name -> function.
        n: number of joints, when the model says so.
        origin: the file that it was read from, None when it was not.
        uncompared: its other functions of a state, which nothing compares.
        aliases: short names under which its Coriolis function goes: C may be the matrix or its torque.
    """

    origin: Origin | None = None
    uncompared: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()

    def __init__(self, calls: Mapping[str, Callable[..., Any]], n: int | None = None) -> None:
        """Keep the functions by their names."""
        self.calls, self.n = dict(calls), n

    def convert(self, convention: Convention) -> Functions:
        """Return the functions in the coordinates of the robot."""
        self.calls = forms.adapted(self.calls, convention.n is not None)
        if set(self.aliases) - set(convention.mapped):
            n = convention.n or self.n
            self._tell_torque(range(2, _MOST_TRIED + 1) if n is None else [n])
        if convention.A is None:
            name = "forward_dynamics"
            if convention.passive and name in self.calls:
                self.calls[name] = convention.convert(name, self.calls[name])
            return self
        return Functions({name: convention.convert(name, call) for name, call in self.calls.items()}, self.n)

    def _tell_torque(self, counts: Iterable[int]) -> None:
        """Take a Coriolis function for what it gives with some number of joints: a matrix, or its torque."""
        call = self.calls["coriolis_matrix"]
        for n in counts if "coriolis_torque" not in self.calls else ():
            if n == 1:
                continue
            with suppress(Exception):  # what it raises is told when it is compared
                if np.shape(call(np.full(n, 0.1), np.full(n, 0.1))) in ((n,), (n, 1), (1, n)):
                    self.calls["coriolis_torque"] = self.calls.pop("coriolis_matrix")
                    return


def resolve(model: Any, source: str | None = None, convention: Convention | None = None) -> Functions:
    """Return the functions of whatever a user calls a model.

    Args:
        model: the model.
        source: text to run in place of that of its file.
        convention: how it may differ from the robot without being wrong.

    Raises:
        Unusable: when it is none, saying what was expected.
    """
    used = convention or Convention(SHORT)
    if isinstance(model, str) and model in PAPER:
        from armgpi.paper.arm import PaperArm

        return _of_object(_with_names(PaperArm(), used)).convert(used)
    if isinstance(model, str | Path):
        module, name = _load(str(model), source)

        def again() -> Functions:
            return _of_object(_with_names(getattr(module, name) if name else module, used)).convert(used)

        functions = again()
        functions.uncompared = _uncompared_names(getattr(module, name) if name else module)
        path = getattr(module, "__file__", None)
        if path is not None and Path(path).suffix in _SUFFIXES:
            text = _text(Path(path)) if source is None else source
            functions.origin = Origin(str(path), text, module, again)
        return functions
    functions = _of_object(_with_names(model, used)).convert(used)
    functions.uncompared = _uncompared_names(model)
    return functions


def _with_names(thing: Any, convention: Convention) -> Any:
    """Return a model whose functions have their full names too.

    Raises:
        Unusable: when it lacks a function that is mapped, or has another one of that name.
    """
    members = [_members(one) for one in (thing, *_parts_of(thing))]
    for mine in convention.mapped:
        name = convention.names[mine]
        owner = next((m for m in members if _is_function(m.get(mine))), None)
        if owner is None:
            raise Unusable(f"has no function {mine!r}, which is mapped to {name}{_hint(mine, members)}")
        own = owner.get(name)
        is_another = _is_function(own) and own is not owner[mine]
        if is_another and not (callable(own) and own == owner[mine]):
            raise Unusable(f"has a function {name}, and {mine!r} is mapped to {name} too: drop one")
    return _rename(thing, convention.names, convention.mapped)


def _hint(mine: str, members: Iterable[Mapping[str, Any]]) -> str:
    """Return which function may be meant by a name that there is not, or which there are."""
    from difflib import get_close_matches

    there = sorted({k for m in members for k, v in m.items() if _is_function(v) and k[:1] != "_"})
    longer = [name for name in there if name.startswith(mine)]
    near = longer or get_close_matches(mine, there, n=1, cutoff=0.5)
    return f"; is {near[0]!r} meant?" if near else f"; it has {', '.join(there[:12]) or 'none'}"


def _members(thing: Any) -> dict[str, Any]:
    """Return what a thing has, by names."""
    if isinstance(thing, Mapping):
        return {str(k): v for k, v in thing.items()}
    names = vars(thing) if isinstance(thing, ModuleType) else dir(thing)
    return {name: getattr(thing, name, None) for name in names if not name.startswith("__")}


def _parts_of(thing: Any) -> Iterator[Any]:
    """Yield the classes and the objects of a module's own classes."""
    for value in list(vars(thing).values()) if isinstance(thing, ModuleType) else ():
        own = value if isinstance(value, type) else type(value)
        if own.__module__ == thing.__name__:
            yield value


def _uncompared_names(thing: Any) -> tuple[str, ...]:
    """Return the functions of a state that nothing compares, and that no other one of the model calls."""
    found: dict[str, None] = {}
    called: set[str] = set()
    for members in map(_members, (thing, *_parts_of(thing))):
        compared = []
        for known in (*SHORT, *ARGUMENTS):
            function = members.get(known)
            if callable(function) and not _is_helper(SHORT.get(known, known), function):
                compared.append(function)
        for name, value in members.items():
            code = getattr(value, "__code__", None)
            if code is None or name.startswith("_") or value.__name__ in found:
                continue
            called |= names_of(code)
            letters = [x for x in code.co_varnames[: code.co_argcount] if x != "self"]
            takes_state = 0 < len(letters) < 4 and letters[0] in POSITIONS
            local = not isinstance(thing, ModuleType) or value.__module__ == thing.__name__
            if local and takes_state and value not in compared:
                found[name] = None
    return tuple(name for name in found if name not in called)


def names_of(code: CodeType) -> set[str]:
    """Return the names that a function looks up, also in its comprehensions."""
    inner = (part for part in code.co_consts if isinstance(part, CodeType))
    return set(code.co_names).union(*map(names_of, inner))


def _rename(thing: Any, names: Mapping[str, str], mapped: Sequence[str]) -> Any:
    def is_one(name: str, value: Any) -> bool:
        # A list called C may be one of lengths.
        listed = isinstance(value, list | tuple) and name not in mapped
        return _is_function(value) and not (listed and not expressions.depends_on_state(value))

    if isinstance(thing, Mapping):
        own = {k: v for k, v in thing.items() if not _is_plain_number(v)}
        renamed = {names[k]: v for k, v in thing.items() if k in names and is_one(k, v)}
        return {**thing, **renamed, **own}
    # A module is read again while changes of it are tried: what it had under a short name is then another.
    before = vars(thing).setdefault(ALIASES, {}) if isinstance(thing, ModuleType) else {}
    for mine, name in names.items():
        held = getattr(thing, name, None)
        if not is_one(mine, value := getattr(thing, mine, None)):
            continue
        if _is_plain_number(held) or (_holds_numbers(held) and callable(value)):
            before[name] = mine  # the model computes with gravity = 9.81
        elif held is None or before.get(name) == mine:
            with suppress(AttributeError, TypeError):  # an object that takes no attributes
                setattr(thing, name, value)
                before[name] = mine
    for part in _parts_of(thing):
        if isinstance(part, type):
            _rename(part, names, mapped)
    return thing


def _is_plain_number(value: Any) -> bool:
    """Tell whether a value is a number, or an array of numbers: ``gravity`` may be one beside ``g(q)``."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "iuf"
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _holds_numbers(value: Any) -> bool:
    """Tell whether a value is a number or several: a list may as well be the formulas of a function."""
    several = isinstance(value, list | tuple) and bool(value)
    return all(map(_is_plain_number, value)) if several else _is_plain_number(value)


def _is_function(value: Any) -> bool:
    """Tell whether a value can be a function of a model: `M` may be a mass."""
    if callable(value) or hasattr(value, "free_symbols") or hasattr(value, "is_symbolic"):
        return True
    return expressions.is_list(value) or (
        isinstance(value, np.ndarray) and value.dtype == object and is_drawn(value)
    )


def _load(text: str, source: str | None) -> tuple[ModuleType, str]:
    """Return the module and the name in it that ``file.py``, ``file.py:Name`` or ``module:Name`` means."""
    place, name = text, ""
    # A file may have a colon in its name.
    if not Path(text).exists() and ":" in text:
        place, name = text.rsplit(":", 1)
    path = Path(place)
    if path.name == "__init__.py" or (path / "__init__.py").is_file():
        folder = (path if path.is_dir() else path.parent).resolve()
        sys.path.insert(0, str(folder.parent))
        module = importlib.import_module(folder.name)
    elif path.suffix in _SUFFIXES or path.exists():
        _check_file(path)
        module = _run(path, source)
    else:
        module = _import(place)
    if name and not hasattr(module, name):
        raise Unusable(f"has no {name!r}")
    return module, name


def _check_file(path: Path) -> None:
    """Refuse what is no file, or none that a model is read from."""
    if path.is_dir():
        raise Unusable("this is a folder; give a Python file, a module or 'paper'")
    if not path.exists():
        near = ", ".join(sorted(each.name for each in path.parent.glob("*.py"))[:3])
        raise Unusable(f"there is no such file; in that folder there is {near or 'no Python file'}")
    if path.suffix not in _SUFFIXES:
        raise Unusable(
            "expected a Python file (.py), a notebook (.ipynb) or a file of SymPy expressions (.sympy), "
            f"got {path.suffix!r}" + (_MATLAB if path.suffix == ".m" else "")
        )


def _text(path: Path) -> str:
    """Return the text of a file; of a notebook its code, in which commands of the shell become comments.

    Raises:
        Unusable: when it is none.
    """
    try:
        content = files.read_bytes(path, _MOST_BYTES)
        encoding, _ = tokenize.detect_encoding(io.BytesIO(content).readline)  # which its first lines say
        text = io.TextIOWrapper(io.BytesIO(content), encoding).read()
    except OSError as error:
        raise Unusable(f"cannot be read: {files.reason(error)}") from None
    except (UnicodeDecodeError, SyntaxError) as error:
        raise Unusable(f"is no text in UTF-8: {error}") from None
    if path.suffix != NOTEBOOK:
        return text
    try:
        cells = [c["source"] for c in json.loads(text)["cells"] if c["cell_type"] == "code"]
    except (ValueError, KeyError, TypeError) as error:
        raise Unusable(f"is no notebook: {type(error).__name__}: {error}") from None
    lines = "\n".join("".join(cell) for cell in cells).splitlines()
    return "".join(f"# {x}\n" if x.lstrip()[:1] in ("%", "!") else f"{x}\n" for x in lines)


def _run(path: Path, source: str | None) -> ModuleType:
    """Run a file, or another text in its place, as a module; its own folder is searched for imports."""
    sys.path.insert(0, str(path.resolve().parent))
    text = _text(path) if source is None else source
    module = ModuleType(path.stem)
    module.__file__ = str(path)
    if path.suffix in SYMPY_SUFFIXES:
        # As in a notebook: all of SymPy's names, and q1, v1, ... without a declaration.
        exec("from sympy import *", module.__dict__)
        letters = [f"{letter}{i}" for letter in ("q", "v", "a", "tau") for i in range(1, 10)]
        module.__dict__.update({name: _sympy().Symbol(name, real=True) for name in letters})
    sys.modules[path.stem] = module  # dataclasses look their module up
    exec(compile(text, str(path), "exec"), module.__dict__)
    return module


def _import(name: str) -> ModuleType:
    """Import a module by its name."""
    if name.startswith("."):
        raise Unusable(_NOWHERE)
    if "" not in sys.path:
        sys.path.insert(0, "")  # a module beside the user, as `python -m` has it; it may import others later
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        # A module that is there but imports what is not is another mistake.
        if error.name is not None and (name == error.name or name.startswith(f"{error.name}.")):
            raise Unusable(_NOWHERE) from None
        raise


def _sympy() -> Any:
    try:
        import sympy
    except ImportError:
        raise Unusable("SymPy is not installed: pip install sympy") from None
    return sympy


def _of_object(thing: Any) -> Functions:
    """Return the functions of a module, class, instance or mapping."""
    if isinstance(thing, ModuleType):
        return _of_module(thing)
    if isinstance(thing, type):
        thing = _instance(thing)
    if isinstance(thing, Mapping):
        return _of_names(thing)
    if not any(hasattr(thing, name) for name in ARGUMENTS) and callable(thing):
        thing = thing()
    return _of_instance(thing)


def _of_module(module: ModuleType) -> Functions:
    """Return the functions of a module: its own, those of its one class, or its SymPy expressions."""
    known = [value for name in ARGUMENTS if (value := _get(module, name)) is not None]
    parts = [part for part in _parts_of(module) if any(hasattr(part, name) for name in ARGUMENTS)]
    if known and not (parts and all(map(_is_plain_number, known))):
        return _of_names(module)
    classes = [part for part in parts if isinstance(part, type)]
    if len(classes) > 1:
        names = ", ".join(c.__name__ for c in classes)
        raise Unusable(f"has several models ({names}); choose one with a colon: FILE:{classes[0].__name__}")
    if classes:
        return _of_instance(_instance(classes[0]))
    # A file may end in `arm = Arm(length=0.3)`.
    if len(parts) == 1:
        return _of_instance(parts[0])
    # Or in the equations of SymPy's mechanics.
    if (torques := expressions.inverse_dynamics_of(vars(module))) is not None:
        parameters = _get(module, "parameters") or expressions.numbers_by_symbols(vars(module))
        return _of_names({"inverse_dynamics": torques, "parameters": parameters})
    raise Unusable(_nothing(vars(module)))


def _instance(kind: type) -> Any:
    """Return an object of a class without arguments."""
    try:
        inspect.signature(kind).bind()
    except TypeError as error:
        raise Unusable(f"{kind.__name__} cannot be made without arguments: {error}") from None
    except ValueError:
        pass  # no signature to look at
    return kind()


def _of_instance(thing: Any) -> Functions:
    """Return the functions of an object; its parameters may be a dataclass or a mapping."""
    if not any(hasattr(thing, name) for name in ARGUMENTS):
        raise Unusable(_nothing(dir(thing)))
    return _of_names(thing)


def _of_names(thing: Any) -> Functions:
    """Return the functions of a thing by their names, or its expressions as functions."""
    parameters = _get(thing, "parameters")
    own = _numbers_of(parameters)
    if parameters is None and isinstance(thing, ModuleType):
        own = expressions.numbers_by_symbols(vars(thing))
    there = {
        name: expressions.as_list(value) for name in ARGUMENTS if (value := _get(thing, name)) is not None
    }
    # What is a number under a known name is none of the functions, if there are others.
    there = {name: value for name, value in there.items() if not _is_plain_number(value)} or there
    if drawn := {name: value for name, value in there.items() if is_drawn(value)}:
        return _of_graph(drawn, own)
    casadi: Any = sys.modules.get("casadi")
    if casadi is not None and any(isinstance(value, casadi.SX | casadi.MX) for value in there.values()):
        return _of_casadi(casadi, there, own)
    sympy: Any = sys.modules.get("sympy")
    symbolic = () if sympy is None else (sympy.MatrixBase, sympy.Basic, list)
    if formulas := {name: value for name, value in there.items() if isinstance(value, symbolic)}:
        return _of_expressions(formulas, own, parameters)
    return _of_callables(thing, there)


def _get(thing: Any, name: str) -> Any:
    """Return an item of a mapping, or an attribute of anything else; None where there is none.

    Of a number the function that has the name besides: by another name in a module, or in the class.
    """
    if isinstance(thing, Mapping):
        return thing.get(name)
    value = getattr(thing, name, None)
    if not _holds_numbers(value):
        return value
    if isinstance(thing, ModuleType):
        return getattr(thing, vars(thing).get(ALIASES, {}).get(name, name))
    of_class = getattr(type(thing), name, None)
    return of_class.__get__(thing) if inspect.isfunction(of_class) else value


def _of_callables(thing: Any, calls: Mapping[str, Any]) -> Functions:
    """Return the known functions of a model as they are, and how many joints it says that it has.

    Args:
        thing: the module, object or mapping that the functions are of.
        calls: what it has by known names.

    Raises:
        Unusable: when it has none, or one is no function.
    """
    own = {name: value for name, value in calls.items() if not _is_helper(name, value)}
    calls = own or calls
    for name, value in calls.items():
        if not callable(value):
            raise Unusable(f"{name} must be a function (or a SymPy expression), got {type(value).__name__}")
    if not calls:
        raise Unusable(f"has none of the functions {', '.join(ARGUMENTS)}")
    joints = _get(thing, "n")
    counts = isinstance(joints, int | np.integer) and not isinstance(joints, bool)
    functions = Functions(calls, int(joints) if counts else None)
    matrix = calls.get("coriolis_matrix")
    # By a short name, as C, it may be the torque instead.
    if getattr(matrix, "__name__", "") != "coriolis_matrix":
        functions.aliases = tuple(k for k in _EITHER if callable(x := _get(thing, k)) and x == matrix)
    return functions


def _is_helper(name: str, function: Any) -> bool:
    """Tell whether a function of kinematics is another one of that name: `jacobian(link, point, q)`, say."""
    if name not in _KINEMATICS or not callable(function):
        return False
    try:
        inspect.signature(function).bind(*ARGUMENTS[name])
    except TypeError:
        return True
    except ValueError:  # no signature to look at
        return False
    return False


def _of_graph(drawn: Mapping[str, Any], own: Mapping[str, float]) -> Functions:
    """Return the functions of expressions that are drawn as a graph."""
    programs = {name: Program(e) for name, e in drawn.items()}
    places = states_of(set().union(*(p.names for p in programs.values())) - own.keys())

    def call(name: str, *state: Any) -> Any:
        return programs[name]({**_values_at(places, name, state), **own})

    return _of_call(call, programs)


def _of_call(call: Callable[..., Any], names: Iterable[str], n: int | None = None) -> Functions:
    """Return the functions of one that takes their names first."""
    return Functions({name: partial(call, name) for name in names}, n)


def _values_at(places: Mapping[str, tuple[str, int]], name: str, state: Sequence[Any]) -> dict[str, float]:
    """Return the values of symbols, which are entries of a function's arguments; others are zero."""
    given = dict(zip(ARGUMENTS[name], state, strict=True))
    # A velocity may be left in a gravity that does not depend on it.
    return {s: given[letter][k] if letter in given else 0.0 for s, (letter, k) in places.items()}


def _of_casadi(casadi: Any, given: Mapping[str, Any], own: Mapping[str, float]) -> Functions:
    """Return the functions of CasADi's expressions in q, v, a, tau, or in q1, v1, ..., and parameters."""
    symbols = {str(x): x for e in given.values() for x in casadi.symvar(casadi.vertcat(casadi.vec(e)))}
    places = _places(sorted(symbols.keys() - own.keys()))
    sizes = [e.shape[0] for name, e in given.items() if name not in ("forward_kinematics", "jacobian")]
    n = max([k + 1 for _, k in places.values()] + sizes)
    calls = {name: casadi.Function(name, [*symbols.values()], [e]) for name, e in given.items()}

    def call(name: str, *state: Any) -> Any:
        values = {**_values_at(places, name, state), **own}
        return np.asarray(calls[name](*(float(values[k]) for k in symbols))).squeeze()

    return _of_call(call, calls, n)


def _places(names: Iterable[str]) -> dict[str, tuple[str, int]]:
    """Return which entry (from 0) of which quantity symbols of CasADi are.

    Raises:
        Unusable: when one of them is none.
    """
    found = {}
    for name in names:
        joint = joint_of(name)
        if joint is None:
            raise Unusable(
                f"has the symbol {name}, which is neither q_0, q1, v1 or the like nor in `parameters`"
            )
        found[name] = joint
    # The entries of a vector q are called q_0, q_1, ...
    zero = any("_" in name or k == 0 for name, (_, k) in found.items())
    return {name: (letter, k if zero else k - 1) for name, (letter, k) in found.items()}


def _of_expressions(given: Mapping[str, Any], own: Mapping[str, float], parameters: Any) -> Functions:
    """Return the functions of SymPy expressions in q1.., v1.., a1.., tau1.. and parameters."""
    sympy = _sympy()
    parameters = parameters if isinstance(parameters, Mapping) else {}
    fixed = {sympy.Symbol(str(k)): v for k, v in parameters.items() if not _is_number(v)}
    plain: dict[str, Any] = {}
    joints: dict[Any, tuple[str, int]] = {}
    for name, expression in given.items():
        plain[name] = expressions.plain(sympy, expression)
        joints |= _joints_in(sympy, name, plain[name], own, fixed)
    first = min({1, *(k for _, k in joints.values())})  # q0, q1, .. or q1, q2, ..
    # Gravity may not depend on the last joint, but has an entry for it.
    sizes = [max(getattr(e, "shape", (1,))) for e in plain.values()]
    n = max(sizes + [k + 1 - first for _, k in joints.values()])

    def place(letter: str, k: int) -> Any:
        return sympy.Symbol(f"{letter}_{k + 1}__")

    swap = {**fixed, **{symbol: place(letter, k - first) for symbol, (letter, k) in joints.items()}}
    calls = {}
    for name, expression in plain.items():
        arguments = [list(map(partial(place, letter), range(n))) for letter in ARGUMENTS[name]]
        arguments.append(list(map(sympy.Symbol, own)))
        calls[name] = sympy.lambdify(arguments, expression.xreplace(swap), "numpy", cse=True)

    def call(name: str, *state: Any) -> Any:
        return calls[name](*map(np.ndarray.tolist, state), list(own.values()))

    return _of_call(call, calls, n)


def _joints_in(
    sympy: Any, name: str, expression: Any, own: Mapping[str, float], fixed: Mapping[Any, Any]
) -> dict[Any, tuple[str, int]]:
    """Return which quantity of which joint the symbols of an expression are; its parameters are left out.

    Raises:
        Unusable: when the expression is infinite, or has a symbol that it must not have.
    """
    if expression.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
        raise Unusable(f"{name} divides by zero: it contains infinity or NaN")
    found = {}
    for symbol in expression.free_symbols:
        if symbol.name in own:  # a1, a2 may be lengths
            continue
        joint = joint_of(symbol.name)
        if joint is not None and joint[0] not in ARGUMENTS[name]:
            takes = ", ".join(ARGUMENTS[name])
            raise Unusable(f"{name} has the symbol {symbol.name}, but it is a function of {takes} alone")
        if joint is not None:
            found[symbol] = joint
        elif symbol not in fixed:
            raise Unusable(
                f"{name} has the symbol {symbol.name}, which is neither q1, v1, a1, tau1 or the like "
                "nor in `parameters`; add its value there"
            )
    return found


def _numbers_of(parameters: Any) -> dict[str, float]:
    """Return the numbers among a model's parameters."""
    if dataclasses.is_dataclass(parameters) and not isinstance(parameters, type):
        items: Any = {f.name: getattr(parameters, f.name) for f in dataclasses.fields(parameters)}.items()
    elif isinstance(parameters, Mapping):
        items = parameters.items()
    else:
        return {}
    return {str(key): float(value) for key, value in items if _is_number(value)}


def _is_number(value: Any) -> bool:
    """Tell whether a value is one finite real number (of NumPy, SymPy or Python)."""
    if isinstance(value, bool) or callable(value):
        return False  # a switch, not a number
    if isinstance(value, int | float | np.integer | np.floating):
        return math.isfinite(value)
    return bool(getattr(value, "is_number", False) and getattr(value, "is_real", False))


def _nothing(names: Any) -> str:
    """Return the message for a model without any known function."""
    text = f"has none of the functions {', '.join(ARGUMENTS)}"
    if isinstance(names, Mapping) and (lines := _proposed(names)):
        return f"{text}; its expressions of SymPy are compared with {lines}"
    told = what_it_has(names) if isinstance(names, Mapping) else ""
    for name in map(str, names):
        near = near_function(name, ARGUMENTS) if name[:1] != "_" else None
        if near is None:
            continue
        code = getattr(names.get(name) if isinstance(names, Mapping) else None, "__code__", None)
        # What takes every angle apart is no function of that name.
        if code is None or code.co_argcount == len(ARGUMENTS[near]):
            return f"{text}; is {name!r} meant to be {near!r}? --map {name}={near}"
    return text + told


def _proposed(names: Mapping[str, Any]) -> str:
    """Return the options that say what a module's expressions are; "" where none is seen."""
    parameters = names.get("parameters")
    own = _numbers_of(parameters) if parameters is not None else expressions.numbers_by_symbols(names)
    found = expressions.proposals(names, own)
    return " ".join(f"--map {mine}={function}" for function, mine in found.items())
