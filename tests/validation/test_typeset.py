"""Expressions of models as formulas of pages and papers."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from armgpi.base.escape import latex_text
from armgpi.validation.typeset import mathml, tex

#: Python -> LaTeX, written by hand.
FORMULAS = {
    "m2*l1**2": r"m_{2}\,{l_{1}}^{2}",
    "np.cos(q[0] + q[1])": r"\cos \left(q_{1}+q_{2}\right)",
    "a - (b - c)": r"a-\left(b-c\right)",
    "a - b + c": "a-b+c",
    "-(a + b)": r"-\left(a+b\right)",
    "a + -b": r"a+\left(-b\right)",
    "-a * -b": r"-a\,\left(-b\right)",
    "(a + b)**2": r"{\left(a+b\right)}^{2}",
    "a * 2": r"a\cdot 2",
    "a / (b + 1)": r"\frac{a}{b+1}",
    "np.cross(w, I @ w)": r"w\times \left(I\,w\right)",
    "R[i].T @ f": r"{R_{i}}^{T}\,f",
    "p['lc2']": "l_{c2}",
    "self.p.alpha": r"\alpha ",
    "np.array([[a, b], [b, c]])": r"\begin{bmatrix}a & b \\ b & c\end{bmatrix}",
    "sqrt(2)": r"\sqrt{2}",
}


@pytest.mark.parametrize("code", FORMULAS)
def test_expressions_are_set(code: str) -> None:
    assert tex(code) == FORMULAS[code]
    page = mathml(code)
    assert page is not None
    assert ElementTree.fromstring(page).tag == "math"


@pytest.mark.parametrize("code", ["lambda x: x", "[x for x in y]", "f(", "'text'", "x" * 700, "a and b", ""])
def test_what_has_no_usual_form_is_left_out(code: str) -> None:
    assert tex(code) is None
    assert mathml(code) is None


def test_text_of_a_source_cannot_leave_its_formula() -> None:
    page = mathml("p['</math><script>alert(1)</script>']")
    assert page is not None
    assert [node.tag for node in ElementTree.fromstring(page).iter()] == ["math", "mi"]


def test_whatever_a_report_says_is_latex() -> None:
    # pdflatex stops at characters that it has no command for, and math at a key's % or _.
    text = latex_text("θ Δt ℓ₂ é < ο ∑ q̇ 100 % a_b\x01")
    assert text == r"$\theta$ $\Delta$t l2 e $<$ o ? $\dot q$ 100 \% a\_b?"
    assert tex("θ * p['a%$_b']") == r"\text{$\theta$}\,\text{a\%\$\_b}"
