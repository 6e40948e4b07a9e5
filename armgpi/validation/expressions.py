"""SymPy as people write it: expressions under names of their own, and the objects of its mechanics.

A file may end in ``tau = [...]``, ``M = [[...], [...]]`` or ``LM.form_lagranges_equations()``. What such an
expression is follows from its shape and from the state that it depends on.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
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


class _Seen(NamedTuple):
    """An expression in plain symbols, and the letters of the states that it depends on."""

    matrix: Any
    letters: frozenset[str]
    joints: frozenset[int]


def is_list(value: Any) -> bool:
    """Tell whether a value is a list, a tuple or an array of expressions, not of bare coordinates."""
    if not isinstance(value, list | tuple | np.ndarray) or len(value) == 0:
        return False
    try:
        entries = np.ravel(np.asarray(value, dtype=object))
    except ValueError:  # of several lengths
        return False
    return any(_is_formula(x) for x in entries)


def depends_on_state(value: Any) -> bool:
    """Tell whether one of a list's expressions depends on a joint."""
    entries = np.ravel(np.asarray(value, dtype=object))
    names = (name for x in entries for name in _names_in(x))
    return any(joint_of(name) is not None for name in names)


def as_list(value: Any) -> Any:
    """Return an array or tuple of expressions as a list; anything else as it is."""
    return np.asarray(value, dtype=object).tolist() if is_list(value) else value


def _is_formula(x: Any) -> bool:
    """Tell whether something is an expression that is more than a name."""
    if isinstance(x, Expression):
        return x.op not in ("symbol", "constant")
    return bool(getattr(x, "free_symbols", ())) and bool(getattr(x, "args", ())) and not _is_coordinate(x)


def _is_coordinate(x: Any) -> bool:
    """Tell whether an expression of SymPy is a function of time, or its derivative."""
    return (
        getattr(x, "is_Derivative", False) or type(getattr(x, "func", None)).__name__ == "UndefinedFunction"
    )


def _names_in(x: Any) -> Iterator[str]:
    """Yield the names of symbols and of functions of time in an expression."""
    yield from (str(symbol) for symbol in getattr(x, "free_symbols", ()))
    sympy: Any = sys.modules.get("sympy")
    if sympy is not None and hasattr(x, "atoms"):
        yield from (str(f.func) for f in x.atoms(sympy.core.function.AppliedUndef))


def plain(sympy: Any, expression: Any) -> Any:
    """Return an expression of SymPy in plain symbols: no functions of time, no assumptions.

    Rates of coordinates get names that no length has: ``a1`` may be one.

    Raises:
        Unusable: when it has a derivative of something else.
    """
    if isinstance(expression, list):
        expression = sympy.Matrix(expression)
    applied = sympy.core.function.AppliedUndef
    swap: dict[Any, Any] = {}
    # Second derivatives first: they contain the first ones.
    for derivative in sorted(expression.atoms(sympy.Derivative), key=lambda d: -d.derivative_count):
        letter = {1: "qd", 2: "qdd"}.get(derivative.derivative_count)
        joint = joint_of(str(derivative.expr.func)) if isinstance(derivative.expr, applied) else None
        if joint is not None and joint[0] == "v":  # the derivative of a speed
            letter = {"qd": "qdd"}.get(letter or "")
        if letter is None or joint is None:
            raise Unusable(f"cannot read {derivative} in an expression")
        swap[derivative] = sympy.Symbol(f"{letter}{joint[1]}")
    expression = expression.subs(swap) if swap else expression
    swap = {f: sympy.Symbol(str(f.func)) for f in expression.atoms(applied)}
    swap |= {symbol: sympy.Symbol(symbol.name) for symbol in expression.free_symbols}
    return expression.subs({k: v for k, v in swap.items() if isinstance(k, applied)}).xreplace(swap)


def numbers_by_symbols(names: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers that a module's dictionaries have by symbols: ``values = {m1: 2.0}``.

    A dictionary with a position is one of a state, and left out; so is what two dictionaries have otherwise.
    """
    found: dict[str, set[float]] = {}
    for mapping in (x for x in list(names.values()) if isinstance(x, dict) and _are_parameters(x)):
        for key, value in mapping.items():
            if isinstance(value, int | float):
                found.setdefault(str(key), set()).add(float(value))
    return {name: values.pop() for name, values in found.items() if len(values) == 1}


def _are_parameters(mapping: Mapping[Any, Any]) -> bool:
    """Tell whether all keys are symbols, and none is a position."""
    symbols = all(
        hasattr(key, "free_symbols") and isinstance(getattr(key, "name", None), str) for key in mapping
    )
    return symbols and not any((joint_of(str(key)) or "")[:1] == ("q",) for key in mapping)


def proposals(names: Mapping[str, Any], own: Iterable[str]) -> dict[str, str]:
    """Return which of a module's expressions are which function, function -> name; the last of each.

    Args:
        names: what the module has.
        own: names of its parameters.
    """
    sympy: Any = sys.modules.get("sympy")
    if sympy is None or not hasattr(sympy, "core"):
        return {}
    seen = {}
    for name, value in names.items():
        if name[:1] != "_" and (one := _seen(sympy, value, frozenset(own))) is not None:
            seen[name] = one
    joints = frozenset().union(*(one.joints for one in seen.values()))
    found: dict[str, str] = {}
    for name, one in seen.items():
        function = _function_of(one, len(joints))
        if function is not None:
            found.pop(function, None)
            found[function] = name
    if "inverse_dynamics" in found:  # its parts need not be told apart from anything else
        return {k: v for k, v in found.items() if k not in ("coriolis_torque", "gravity")}
    return found


def _seen(sympy: Any, value: Any, own: frozenset[str]) -> _Seen | None:
    """Return an expression with what it depends on; None for what is none, or has a name alone."""
    is_matrix = isinstance(value, sympy.MatrixBase)
    if not is_matrix and not is_list(value) and not (isinstance(value, sympy.Expr) and _is_formula(value)):
        return None
    if is_matrix and not any(map(_is_formula, value)):
        return None
    try:
        matrix = plain(sympy, as_list(value) if not is_matrix else value)
    except Exception:  # a list of anything else
        return None
    found = {joint for x in matrix.free_symbols if x.name not in own and (joint := joint_of(x.name))}
    letters, joints = frozenset(letter for letter, _ in found), frozenset(k for _, k in found)
    return _Seen(matrix, letters, joints) if found else None


def _function_of(one: _Seen, n: int) -> str | None:
    """Return which function an expression is, by its shape and its values; None where it is not seen."""
    letters, shape = one.letters, tuple(getattr(one.matrix, "shape", ()))
    if "tau" in letters:
        return None
    moves, falls = "v" in letters, _has_gravity(one.matrix)
    if "a" in letters:
        return "inverse_dynamics" if shape in ((n, 1), (1, n)) else None
    if moves:
        if shape == (n, n) and n > 1 and _degree(one.matrix) == 1:
            return "coriolis_matrix"
        if _degree(one.matrix) != 2:
            return None
        return "kinetic_energy" if not shape else "coriolis_torque" if shape in ((n, 1), (1, n)) else None
    if shape == (n, n) and n > 1:
        return "mass_matrix" if _is_symmetric(one.matrix) else None
    if not falls:
        return None
    return "potential_energy" if not shape else "gravity" if shape in ((n, 1), (1, n)) else None


def _has_gravity(matrix: Any) -> bool:
    """Tell whether an expression has gravity in it, as a symbol or a number."""
    numbers = (abs(float(x)) for x in matrix.atoms() if getattr(x, "is_Float", False))
    return any(_GRAVITY.fullmatch(x.name) for x in matrix.free_symbols) or any(9.7 < x < 9.9 for x in numbers)


def _value(matrix: Any, speed: float = 1.0) -> Array:
    """Return the values of an expression at some state with so many times its velocities."""
    draw = np.random.default_rng(20261129)
    at = {}
    for symbol in sorted(matrix.free_symbols, key=str):
        joint = joint_of(symbol.name)
        at[symbol] = float(draw.uniform(0.5, 1.5)) * (speed if joint and joint[0] == "v" else 1.0)
    return np.array(matrix.subs(at).evalf(), dtype=np.float64)


def _degree(matrix: Any) -> int | None:
    """Return of which degree in the velocities an expression is, 1 or 2; None for any other."""
    once, twice = _value(matrix), _value(matrix, 2.0)
    least = _SAME * max(float(np.abs(twice).max()), 1e-12)
    return next((k for k in (1, 2) if np.abs(twice - 2.0**k * once).max() <= least), None)


def _is_symmetric(matrix: Any) -> bool:
    value = _value(matrix)
    return bool(np.abs(value - value.T).max() <= _SAME * np.abs(value).max())


def inverse_dynamics_of(names: Mapping[str, Any]) -> Any:
    """Return the torques of the one object of SymPy's mechanics that a module has; None without one.

    Raises:
        Unusable: when there are several, or its equations were not formed.
    """
    kinds = _method_kinds()
    drawn = {id(x): x for x in names.values() if hasattr(type(x), "drawn_equations")}
    if len(drawn) == 1:
        return equations_of(*drawn.values())
    found = {id(x): (name, x) for name, x in names.items() if isinstance(x, kinds)} if kinds else {}
    if len(found) > 1:
        listed = ", ".join(name for name, _ in found.values())
        raise Unusable(f"has several sets of equations of motion ({listed}); delete all but one of them")
    return _equations(*found.popitem()[1]) if found else None


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
        mass, forcing = sympy.Matrix(method.mass_matrix), sympy.Matrix(method.forcing)
    except (ValueError, AttributeError, TypeError):
        raise Unusable(
            f"{name} has no equations yet; call {name}.kanes_equations(bodies, loads) in the file"
        ) from None
    if mass.shape != (n, n) or len(method.u) != n:
        raise Unusable(f"{name} has constraints: {len(method.u)} speeds for {n} coordinates, expected {n}")
    swap = _coordinates(sympy, method, name)
    names = [sympy.Symbol(f"qdd{i + 1}") for i in range(n)]
    equations = (mass * sympy.Matrix(names) - forcing).xreplace(swap)
    return equations.xreplace(dict.fromkeys(_torques(sympy, equations), sympy.Integer(0)))


def _coordinates(sympy: Any, method: Any, name: str) -> dict[Any, Any]:
    """Return what is put in place of coordinates, their rates and speeds."""
    time = sympy.physics.mechanics.dynamicsymbols._t
    rates = [sympy.Derivative(x, time) for x in method.q]
    if hasattr(method, "kindiffdict"):
        known = method.kindiffdict()
        for rate, speed in zip(rates, method.u, strict=True):
            if sympy.simplify(known.get(rate, rate) - speed) != 0:
                raise Unusable(f"{name}: the speed {speed} is not {rate}, as it has to be here")
    swap: dict[Any, Any] = {}
    for i, (x, rate, speed) in enumerate(zip(method.q, rates, method.u, strict=True), 1):
        moving = sympy.Symbol(f"qd{i}")
        swap |= {rate: moving, speed: moving, x: sympy.Symbol(f"q{i}")}
    return swap


def _torques(sympy: Any, equations: Any) -> Sequence[Any]:
    """Return the torques among the symbols and functions of time of equations."""
    symbols = [(x, x.name) for x in equations.free_symbols]
    symbols += [(f, str(f.func)) for f in equations.atoms(sympy.core.function.AppliedUndef)]
    return [x for x, name in symbols if (joint_of(name) or ("",))[0] == "tau" or _TORQUE.fullmatch(name)]
