"""SymPy as people write it: expressions under names of their own, and the objects of its mechanics.

A file may end in ``tau = [...]``, ``M = [[...], [...]]`` or ``LM.form_lagranges_equations()``. What such an
expression is follows from its shape and from the state that it depends on.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.graph import Expression, equations_of, joint_of

#: Names that torques have in SymPy's mechanics, apart from those of :func:`.graph.joint_of`.
_TORQUE = re.compile(r"[TFQ]_?\d+|tau_?\w+")
#: Names that the strength of gravity has.
_GRAVITY = re.compile(r"g_?\d*|grav(ity)?")
#: What values are compared up to, relative: they are of double precision.
_SAME = 1e-9


class Unusable(Exception):
    """A model that cannot be used; the text says why."""


class _Expression(NamedTuple):
    """An expression in plain symbols, and the letters of the states that it depends on."""

    matrix: Any
    letters: frozenset[str]
    joints: frozenset[int]


def is_list(value: Any) -> bool:
    """Tell whether a value is a list, a tuple or an array of expressions, not of bare coordinates."""
    if not isinstance(value, list | tuple | np.ndarray) or len(value) == 0:
        return False
    try:
        entries = _entries(value)
    except ValueError:  # of several lengths
        return False
    return any(_is_formula(x) for x in entries)


def _entries(value: Any) -> Array:
    """Return the entries of a list or an array one after the other."""
    return np.ravel(np.asarray(value, dtype=object))


def depends_on_state(value: Any) -> bool:
    """Tell whether one of a list's expressions depends on a joint."""
    names = chain.from_iterable(map(_names_in, _entries(value)))
    return any(joint_of(name) is not None for name in names)


def as_list(value: Any) -> Any:
    """Return an array or tuple of expressions as a list; anything else as it is."""
    if not is_list(value):
        return value
    return np.asarray(value, dtype=object).tolist()


def _is_formula(x: Any) -> bool:
    """Tell whether something is an expression that is more than a name."""
    if isinstance(x, Expression):
        return x.op not in ("symbol", "constant")
    has_symbols = bool(getattr(x, "free_symbols", ()))
    has_arguments = bool(getattr(x, "args", ()))
    return has_symbols and has_arguments and not _is_coordinate(x)


def _is_coordinate(x: Any) -> bool:
    """Tell whether an expression of SymPy is a function of time, or its derivative."""
    if getattr(x, "is_Derivative", False):
        return True
    return type(getattr(x, "func", None)).__name__ == "UndefinedFunction"


def _names_in(x: Any) -> Iterator[str]:
    """Yield the names of symbols and of functions of time in an expression."""
    yield from (str(symbol) for symbol in getattr(x, "free_symbols", ()))
    sympy: Any = sys.modules.get("sympy")
    if sympy is not None and hasattr(x, "atoms"):
        for coordinate in x.atoms(sympy.core.function.AppliedUndef):
            yield str(coordinate.func)


def plain(sympy: Any, expression: Any) -> Any:
    """Return an expression of SymPy in plain symbols: no functions of time, no assumptions.

    Rates of coordinates get names that no length has: ``a1`` may be one.

    Raises:
        Unusable: when it has a derivative of something else.
    """
    if isinstance(expression, list):
        expression = sympy.Matrix(expression)
    applied = sympy.core.function.AppliedUndef
    # Second derivatives first: they contain the first ones.
    derivatives = sorted(expression.atoms(sympy.Derivative), key=lambda d: -d.derivative_count)
    if derivatives:
        expression = expression.subs({d: sympy.Symbol(_rate_name(d, applied)) for d in derivatives})
    coordinates = {f: sympy.Symbol(str(f.func)) for f in expression.atoms(applied)}
    symbols = {symbol: sympy.Symbol(symbol.name) for symbol in expression.free_symbols}
    return expression.subs(coordinates).xreplace({**coordinates, **symbols})


def _rate_name(derivative: Any, applied: type) -> str:
    """Return the name of a coordinate's rate, qd1, or of the rate of that, qdd1.

    Raises:
        Unusable: when it is the derivative of something else.
    """
    is_of_coordinate = isinstance(derivative.expr, applied)
    joint = joint_of(str(derivative.expr.func)) if is_of_coordinate else None
    if joint is not None:
        order = derivative.derivative_count
        if joint[0] == "v":  # the derivative of a speed
            order += 1
        letter = {1: "qd", 2: "qdd"}.get(order)
        if letter is not None:
            return f"{letter}{joint[1]}"
    raise Unusable(f"cannot read {derivative} in an expression")


def numbers_by_symbols(names: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers that a module's dictionaries have by symbols: ``values = {m1: 2.0}``.

    A dictionary with a position is one of a state, and left out; so is what two dictionaries have otherwise.
    """
    values_of: dict[str, set[float]] = {}
    for mapping in list(names.values()):
        if not isinstance(mapping, dict) or not _are_parameters(mapping):
            continue
        for key, value in mapping.items():
            if isinstance(value, int | float):
                values_of.setdefault(str(key), set()).add(float(value))
    return {name: values.pop() for name, values in values_of.items() if len(values) == 1}


def _are_parameters(mapping: Mapping[Any, Any]) -> bool:
    """Tell whether all keys are symbols, and none is a position."""
    for key in mapping:
        is_symbol = hasattr(key, "free_symbols") and isinstance(getattr(key, "name", None), str)
        if not is_symbol:
            return False
    return not any(_letter_of(str(key)) == "q" for key in mapping)


def _letter_of(name: str) -> str:
    """Return which quantity of a joint a symbol's name means: q, v, a or tau; "" for none."""
    joint = joint_of(name)
    return "" if joint is None else joint[0]


def proposals(names: Mapping[str, Any], own: Iterable[str]) -> dict[str, str]:
    """Return which of a module's expressions are which function, function -> name; the last of each.

    Args:
        names: what the module has.
        own: names of its parameters.
    """
    sympy: Any = sys.modules.get("sympy")
    if sympy is None or not hasattr(sympy, "core"):
        return {}
    expressions: dict[str, _Expression] = {}
    for name, value in names.items():
        expression = None if name.startswith("_") else _as_expression(sympy, value, frozenset(own))
        if expression is not None:
            expressions[name] = expression
    joints = {joint for expression in expressions.values() for joint in expression.joints}
    name_of: dict[str, str] = {}
    for name, expression in expressions.items():
        function = _function_of(expression, len(joints))
        if function is not None:
            name_of.pop(function, None)  # so that it stands where its last expression does
            name_of[function] = name
    if "inverse_dynamics" in name_of:  # its parts need not be told apart from anything else
        name_of.pop("coriolis_torque", None)
        name_of.pop("gravity", None)
    return name_of


def _as_expression(sympy: Any, value: Any, own: frozenset[str]) -> _Expression | None:
    """Return an expression with what it depends on; None for what is none, or has a name alone."""
    is_matrix = isinstance(value, sympy.MatrixBase)
    if is_matrix:
        is_read = any(map(_is_formula, value))
    else:
        is_read = is_list(value) or (isinstance(value, sympy.Expr) and _is_formula(value))
    if not is_read:
        return None
    try:
        matrix = plain(sympy, value if is_matrix else as_list(value))
    except Exception:  # a list of anything else
        return None
    states = {joint_of(symbol.name) for symbol in matrix.free_symbols if symbol.name not in own}
    letters_and_joints = [state for state in states if state is not None]
    if not letters_and_joints:
        return None
    letters, joints = zip(*letters_and_joints, strict=True)
    return _Expression(matrix, frozenset(letters), frozenset(joints))


def _function_of(expression: _Expression, n: int) -> str | None:
    """Return which function an expression is, by its shape and its values; None where it is not seen."""
    matrix, letters = expression.matrix, expression.letters
    shape = tuple(getattr(matrix, "shape", ()))
    is_number = not shape
    is_vector = shape in ((n, 1), (1, n))
    is_square = shape == (n, n) and n > 1
    if "tau" in letters:
        return None
    if "a" in letters:
        return "inverse_dynamics" if is_vector else None
    if "v" in letters:
        degree = _degree(matrix)
        if is_square and degree == 1:
            return "coriolis_matrix"
        if degree == 2 and is_number:
            return "kinetic_energy"
        return "coriolis_torque" if degree == 2 and is_vector else None
    if is_square:
        return "mass_matrix" if _is_symmetric(matrix) else None
    if not _has_gravity(matrix):
        return None
    if is_number:
        return "potential_energy"
    return "gravity" if is_vector else None


def _has_gravity(matrix: Any) -> bool:
    """Tell whether an expression has gravity in it, as a symbol or a number."""
    if any(_GRAVITY.fullmatch(symbol.name) for symbol in matrix.free_symbols):
        return True
    numbers = [float(atom) for atom in matrix.atoms() if getattr(atom, "is_Float", False)]
    return any(9.7 < abs(number) < 9.9 for number in numbers)


def _value(matrix: Any, speed: float = 1.0) -> Array:
    """Return the values of an expression at some state with so many times its velocities."""
    draw = np.random.default_rng(20261129)
    at = {}
    for symbol in sorted(matrix.free_symbols, key=str):
        factor = speed if _letter_of(symbol.name) == "v" else 1.0
        at[symbol] = float(draw.uniform(0.5, 1.5)) * factor
    value = matrix.subs(at).evalf()
    return np.array(value, dtype=np.float64)


def _degree(matrix: Any) -> int | None:
    """Return of which degree in the velocities an expression is, 1 or 2; None for any other."""
    at_speed = _value(matrix)
    at_twice = _value(matrix, 2.0)
    least = _SAME * max(float(np.abs(at_twice).max()), 1e-12)
    for degree in (1, 2):
        difference = at_twice - 2.0**degree * at_speed
        if np.abs(difference).max() <= least:
            return degree
    return None


def _is_symmetric(matrix: Any) -> bool:
    value = _value(matrix)
    asymmetry = np.abs(value - value.T).max()
    return bool(asymmetry <= _SAME * np.abs(value).max())


def inverse_dynamics_of(names: Mapping[str, Any]) -> Any:
    """Return the torques of the one object of SymPy's mechanics that a module has; None without one.

    Raises:
        Unusable: when there are several, or its equations were not formed.
    """
    kinds = _method_kinds()
    drawn = {id(x): x for x in names.values() if hasattr(type(x), "drawn_equations")}
    if len(drawn) == 1:
        return equations_of(*drawn.values())
    methods: dict[int, tuple[str, Any]] = {}  # by their identity: one may have several names
    for name, value in names.items():
        if isinstance(value, kinds):
            methods[id(value)] = (name, value)
    if not methods:
        return None
    if len(methods) > 1:
        listed = ", ".join(name for name, _ in methods.values())
        raise Unusable(f"has several sets of equations of motion ({listed}); delete all but one of them")
    ((name, method),) = methods.values()
    return _equations(name, method)


def _method_kinds() -> tuple[type, ...]:
    """Return the classes of SymPy that have equations of motion, where a model has imported them."""
    mechanics: Any = sys.modules.get("sympy.physics.mechanics")
    kinds = (getattr(mechanics, name, None) for name in ("LagrangesMethod", "KanesMethod"))
    return tuple(kind for kind in kinds if isinstance(kind, type))


def _equations(name: str, method: Any) -> Any:
    """Return M a - forcing without torques, in q1.., qd1.., qdd1..: the order of the method's coordinates."""
    import sympy
    from sympy.physics.mechanics import LagrangesMethod

    n = len(method.q)
    try:
        if isinstance(method, LagrangesMethod) and method.eom is None:
            method.form_lagranges_equations()
        mass = sympy.Matrix(method.mass_matrix)
        forcing = sympy.Matrix(method.forcing)
    except (ValueError, AttributeError, TypeError):
        raise Unusable(
            f"{name} has no equations yet; call {name}.kanes_equations(bodies, loads) in the file"
        ) from None
    if mass.shape != (n, n) or len(method.u) != n:
        raise Unusable(f"{name} has constraints: {len(method.u)} speeds for {n} coordinates, expected {n}")
    swap = _coordinates(sympy, method, name)
    accelerations = sympy.Matrix([sympy.Symbol(f"qdd{i + 1}") for i in range(n)])
    equations = (mass * accelerations - forcing).xreplace(swap)
    no_torques = dict.fromkeys(_torques(sympy, equations), sympy.Integer(0))
    return equations.xreplace(no_torques)


def _coordinates(sympy: Any, method: Any, name: str) -> dict[Any, Any]:
    """Return what is put in place of coordinates, their rates and speeds."""
    time = sympy.physics.mechanics.dynamicsymbols._t
    rates = [sympy.Derivative(x, time) for x in method.q]
    if hasattr(method, "kindiffdict"):
        speed_of = method.kindiffdict()
        for rate, speed in zip(rates, method.u, strict=True):
            if sympy.simplify(speed_of.get(rate, rate) - speed) != 0:
                raise Unusable(f"{name}: the speed {speed} is not {rate}, as it has to be here")
    swap: dict[Any, Any] = {}
    for i, (x, rate, speed) in enumerate(zip(method.q, rates, method.u, strict=True), 1):
        swap[rate] = swap[speed] = sympy.Symbol(f"qd{i}")
        swap[x] = sympy.Symbol(f"q{i}")
    return swap


def _torques(sympy: Any, equations: Any) -> Sequence[Any]:
    """Return the torques among the symbols and functions of time of equations."""
    named = [(symbol, symbol.name) for symbol in equations.free_symbols]
    functions = equations.atoms(sympy.core.function.AppliedUndef)
    named += [(function, str(function.func)) for function in functions]
    return [x for x, name in named if _letter_of(name) == "tau" or _TORQUE.fullmatch(name)]
