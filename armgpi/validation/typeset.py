"""Expressions of Python set as formulas: MathML for pages, which browsers draw without a script, and LaTeX.

What stands in a model's source is set as it stands there, so that a reader finds it again: nothing is
simplified. Joints count from 1, as in formulas: ``q[0]`` is q₁.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence

from armgpi.base.escape import html_text, latex_text
from armgpi.validation.alternatives import function_name

#: Names of Greek letters, which are set as such.
_GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "theta": "θ",
    "lambda": "λ",
    "mu": "μ",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "psi": "ψ",
    "omega": "ω",
}
_FUNCTIONS = ("sin", "cos", "tan", "exp", "log")
#: How strongly an operation binds: what binds less stands in brackets.
_SUM, _PRODUCT, _SIGN, _POWER, _WHOLE = range(5)
_TOO_LONG = 600


class _Html:
    """MathML, part by part."""

    times, cross, dot = "<mspace width='.17em'></mspace>", "<mo>×</mo>", "<mo>·</mo>"
    transposed = "<mi>T</mi>"

    def row(self, *parts: str) -> str:
        return f"<mrow>{''.join(parts)}</mrow>"

    def number(self, text: str) -> str:
        return f"<mn>{html_text(text)}</mn>"

    def symbol(self, text: str) -> str:
        return f"<mi>{_GREEK.get(text, html_text(text))}</mi>"

    def sign(self, text: str) -> str:
        return f"<mo>{'−' if text == '-' else html_text(text)}</mo>"

    def brackets(self, inner: str) -> str:
        return self.row(self.sign("("), inner, self.sign(")"))

    def under(self, base: str, index: str) -> str:
        return f"<msub>{base}{index}</msub>"

    def over(self, base: str, exponent: str) -> str:
        return f"<msup>{base}{exponent}</msup>"

    def fraction(self, above: str, below: str) -> str:
        return f"<mfrac>{above}{below}</mfrac>"

    def root(self, inner: str) -> str:
        return f"<msqrt>{inner}</msqrt>"

    def matrix(self, rows: Sequence[Sequence[str]]) -> str:
        cells = ("".join(f"<mtd>{cell}</mtd>" for cell in row) for row in rows)
        table = "".join(f"<mtr>{row}</mtr>" for row in cells)
        return self.row(self.sign("["), f"<mtable>{table}</mtable>", self.sign("]"))


class _Tex(_Html):
    """LaTeX, part by part."""

    times, cross, dot = r"\,", r"\times ", r"\cdot "
    transposed = "T"

    def row(self, *parts: str) -> str:
        return "".join(parts)

    def number(self, text: str) -> str:
        return text

    def symbol(self, text: str) -> str:
        if text in _GREEK or text in _FUNCTIONS:
            return rf"\{text} "
        is_letter = len(text) == 1 and text.isascii() and text.isalpha()
        return text if is_letter else rf"\text{{{latex_text(text)}}}"

    def sign(self, text: str) -> str:
        return text

    def brackets(self, inner: str) -> str:
        return rf"\left({inner}\right)"

    def under(self, base: str, index: str) -> str:
        return f"{base}_{{{index}}}"

    def over(self, base: str, exponent: str) -> str:
        return f"{{{base}}}^{{{exponent}}}"

    def fraction(self, above: str, below: str) -> str:
        return rf"\frac{{{above}}}{{{below}}}"

    def root(self, inner: str) -> str:
        return rf"\sqrt{{{inner}}}"

    def matrix(self, rows: Sequence[Sequence[str]]) -> str:
        lines = r" \\ ".join(" & ".join(row) for row in rows)
        return rf"\begin{{bmatrix}}{lines}\end{{bmatrix}}"


class _Unset(Exception):
    """Something that has no usual form as a formula."""


def mathml(code: str) -> str | None:
    """Return an expression as MathML, None when it has no usual form as a formula."""
    inner = _set(code, _Html())
    return None if inner is None else f"<math>{inner}</math>"


def tex(code: str) -> str | None:
    """Return an expression as LaTeX for math mode, None when it has no usual form as a formula."""
    return _set(code, _Tex())


def _set(code: str, form: _Html) -> str | None:
    if len(code) >= _TOO_LONG:
        return None
    try:
        tree = ast.parse(code.strip(), mode="eval")
        return _Setter(form).text(tree.body)
    except (SyntaxError, ValueError, _Unset):
        return None


class _Setter:
    """Sets a syntax tree in one form."""

    def __init__(self, form: _Html) -> None:
        self.form = form

    def of(self, node: ast.expr) -> tuple[str, int]:
        """Return an expression set, and how strongly it binds.

        Raises:
            _Unset: when it has no usual form.
        """
        match node:
            case ast.Constant(value=int() | float() as x):
                digits = repr(x)
                return self.form.number(digits if len(digits) <= 8 else f"{x:g}"), _WHOLE
            case ast.Name(id=name):
                return self.name(name), _WHOLE
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=inner):
                sign = self.form.sign("-" if isinstance(op, ast.USub) else "+")
                return self.form.row(sign, self.least(inner, _PRODUCT)), _SIGN
            case ast.BinOp():
                return self.operation(node)
            case ast.Call():
                return self.call(node)
            case ast.Attribute():
                return self.attribute(node)
            case ast.Subscript():
                return self.entry(node), _WHOLE
            case ast.List(elts=items) | ast.Tuple(elts=items):
                return self.form.matrix(self.rows(items)), _WHOLE
        raise _Unset

    def text(self, node: ast.expr) -> str:
        """Return an expression set, for where no brackets are needed."""
        text, _ = self.of(node)
        return text

    def attribute(self, node: ast.Attribute) -> tuple[str, int]:
        """Return a matrix transposed, or what is called so of an object or a module."""
        if node.attr == "T":
            matrix = self.least(node.value, _WHOLE)
            return self.form.over(matrix, self.form.transposed), _POWER
        return self.name(node.attr), _WHOLE

    def least(self, node: ast.expr, strength: int) -> str:
        """Return an expression set, in brackets where it binds less than it has to."""
        inner, inner_strength = self.of(node)
        return inner if inner_strength >= strength else self.form.brackets(inner)

    def operation(self, node: ast.BinOp) -> tuple[str, int]:
        """Return a sum, a product, a fraction or a power."""
        form, left, right = self.form, node.left, node.right
        _, right_strength = self.of(right)
        has_sign = right_strength == _SIGN  # -a after an operation stands in brackets
        match node.op:
            case ast.Add():
                after = self.least(right, _POWER if has_sign else _SUM)
                return form.row(self.text(left), form.sign("+"), after), _SUM
            case ast.Sub():
                after = self.least(right, _POWER if has_sign else _PRODUCT)
                return form.row(self.text(left), form.sign("-"), after), _SUM
            case ast.Mult() | ast.MatMult():
                before = self.least(left, _PRODUCT)
                after = self.least(right, _POWER if has_sign else _PRODUCT)
                return form.row(before, self._multiplication(right), after), _PRODUCT
            case ast.Div():
                return form.fraction(self.text(left), self.text(right)), _PRODUCT
            case ast.Pow():
                base = form.row(self.least(left, _WHOLE))
                exponent = form.row(self.text(right))
                return form.over(base, exponent), _POWER
        raise _Unset

    def _multiplication(self, right: ast.expr) -> str:
        """Return what stands before a factor: a dot where that begins with a number."""
        first = right
        while isinstance(first, ast.BinOp):
            first = first.left
        return self.form.dot if isinstance(first, ast.Constant) else self.form.times

    def call(self, node: ast.Call) -> tuple[str, int]:
        """Return a sine, a root, a cross product, or what is made an array."""
        match function_name(node), node.args:
            case "array" | "Matrix" | "asarray", [inner]:
                return self.of(inner)
            case "sqrt", [inner]:
                return self.form.root(self.text(inner)), _WHOLE
            case "cross", [left, right]:
                before = self.least(left, _POWER)
                after = self.least(right, _POWER)
                return self.form.row(before, self.form.cross, after), _PRODUCT
            case name, [inner] if name in _FUNCTIONS:
                argument = self.form.brackets(self.text(inner))
                return self.form.row(self.form.symbol(name), argument), _WHOLE
        raise _Unset

    def entry(self, node: ast.Subscript) -> str:
        """Return one entry of an array: its numbers count from 1; one of a dictionary is its name."""
        match node.slice:
            case ast.Constant(value=str() as key) | ast.Tuple(elts=[ast.Constant(value=str() as key)]):
                return self.name(key)
            case ast.Tuple(elts=items):
                indices = [self._index(item) for item in items]
            case index:
                indices = [self._index(index)]
        return self.form.under(self.text(node.value), self.form.row(*indices))

    def _index(self, index: ast.expr) -> str:
        """Return an index: whole numbers from 0 count from 1."""
        match index:
            case ast.Constant(value=int() as number):
                return self.form.number(str(number + 1 if number >= 0 else number))
        return self.text(index)

    def rows(self, items: Sequence[ast.expr]) -> list[list[str]]:
        """Return the entries of a matrix; a plain list is a column."""
        rows = []
        for item in items:
            cells = item.elts if isinstance(item, ast.List | ast.Tuple) else [item]
            rows.append([self.text(cell) for cell in cells])
        return rows

    def name(self, name: str) -> str:
        """Return a name with what follows its first letter as an index: l_c2 for lc2."""
        match = re.fullmatch(r"([A-Za-z]|" + "|".join(_GREEK) + r")_?(c?\d+[a-z]*)", name)
        if match is None:
            return self.form.symbol(name)
        base, index = match.groups()
        return self.form.under(self.form.symbol(base), self.form.number(index))
