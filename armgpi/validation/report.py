"""What a validation found: plain data, text and a page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

from armgpi.base.escape import html_table, json_data, latex_text
from armgpi.base.verdict import Verdict, judge
from armgpi.validation import typeset
from armgpi.validation.conventions import propose_map
from armgpi.validation.diagnose import Cause
from armgpi.validation.laws import Law
from armgpi.validation.models import ARGUMENTS
from armgpi.validation.residual import Difference

#: Elements listed in a line of text, and lines of differences, at most: the JSON has all.
_LISTED, _LINES = 8, 12
#: Kinds of causes that are no mistakes, or have no name.
_WITHOUT_WORTH = ("unknown", "consequence", "neglected", "rounded", "law")


class FunctionReport(NamedTuple):
    """One function of a model beside the reference.

    Attributes:
        function: its name.
        agrees: whether it agrees everywhere.
        max_abs: largest absolute error, in its unit.
        max_rel: the same, relative to the reference's largest value.
        worst: the state where it is largest: name -> values.
        differing: labels of the entries, products or joints that differ: "D[1,2]", "q̇1 q̇2 in τ1", "G[2]".
        diagnosis: the causes of what differs.
        note: what else was found.
    """

    function: str
    agrees: bool
    max_abs: float
    max_rel: float
    worst: dict[str, list[float]]
    differing: tuple[str, ...]
    diagnosis: tuple[Cause, ...]
    note: str = ""

    def worst_at(self, between: str, digits: int) -> str:
        """Return the state where the error is largest as text."""
        values = {name: ", ".join(f"{x:.{digits}g}" for x in each) for name, each in self.worst.items()}
        return between.join(f"{name} = ({text})" for name, text in values.items())


@dataclass(frozen=True)
class DynamicsReport:
    """What a validation found.

    Attributes:
        model: the model, as it was named.
        robot: name of the reference; None without one.
        joint_names: names of its joints.
        states: at how many states they were compared.
        functions: one report per function that the model has.
        causes: the mistakes found, the ones with the largest scope first.
        laws: what holds for every arm, and whether it does for this model.
        notes: what else was seen, such as a link of the robot that no rigid body can be.
        repaired: the model's source with changes with which it agrees; None without such.
        uncompared: further functions of a state that the model has: they are not compared.
        left_out: what of its functions is not compared, such as the rows of a base.
        frame: the frame that was asked for where the model has no kinematics to compare in it.
        numbers_only: numbers of the model that agree by their values alone: with others it would differ.
        differences: what differs in each element as a formula, model less robot.
        symbols: what the numbers in these formulas are, where they have the robot's names.
    """

    model: str
    robot: str | None
    joint_names: tuple[str, ...]
    states: int
    functions: tuple[FunctionReport, ...]
    causes: tuple[Cause, ...]
    laws: tuple[Law, ...]
    notes: tuple[str, ...]
    repaired: str | None = None
    uncompared: tuple[str, ...] = ()
    frame: str | None = None
    numbers_only: tuple[str, ...] = ()
    differences: tuple[Difference, ...] = ()
    symbols: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether every function agrees, for other numbers too, and no law fails; see :meth:`judge`."""
        return (
            not self.numbers_only
            and all(report.agrees for report in self.functions)
            and all(law.verdict != "fails" for law in self.laws)
        )

    @property
    def title(self) -> str:
        """What was compared with what."""
        return f"{self.model} compared with {self.robot}" if self.robot else self.model

    def function(self, function: str) -> FunctionReport:
        """Return the report of one function.

        Args:
            function: its name, such as "mass_matrix".

        Raises:
            KeyError: when the model has no such function.
        """
        for report in self.functions:
            if report.function == function:
                return report
        raise KeyError(function)

    def judge(self, accept_uncompared: bool = False) -> Verdict:
        """Return the verdict: for part where a function or frame was given that nothing was compared with.

        Args:
            accept_uncompared: whether that is accepted.
        """
        left_out = [*(f"function {name}" for name in self.uncompared), *self.left_out]
        left_out += [] if self.frame is None else [f"frame {self.frame}: the model has no kinematics"]
        text = self._found()
        if self.agrees and left_out:
            compared, count = len(self.functions), len(self.functions) + len(self.uncompared)
            text = f"{compared} of {count} functions {'was' if compared == 1 else 'were'} compared"
            if self.robot is None:
                text = f"{text[: -len('compared')]}checked"
            if not self.uncompared:
                done = "compared" if self.functions else "checked; its values were not compared"
                text = f"the model agrees in what was {done}"
        return judge(self.agrees, text, left_out, "--allow-uncompared", accept_uncompared)

    def to_dict(self, accept_uncompared: bool = False) -> dict[str, Any]:
        """Return the report as plain data for JSON; NaN and infinity are None.

        Args:
            accept_uncompared: whether functions that were not compared leave the verdict as it is.
        """
        data: dict[str, Any] = {
            "model": self.model,
            "robot": self.robot,
            "joints": self.joint_names,
            "states": self.states,
            "agrees": self.agrees,
            "verdict": self.judge(accept_uncompared).plain(),
            "functions": [
                {**t._asdict(), "diagnosis": [_plain(cause) for cause in t.diagnosis]} for t in self.functions
            ],
            "causes": [_plain(cause) for cause in self.causes],
            "laws": [law._asdict() for law in self.laws],
            "notes": self.notes,
            "repaired": self.repaired,
            "uncompared": self.uncompared,
            "left_out": self.left_out,
            "numbers_only": self.numbers_only,
            "differences": [
                {**one._asdict(), "latex": typeset.tex(one.formula) if one.formula else None}
                for one in self.differences
            ],
            "symbols": self.symbols,
        }
        return dict(json_data(data))

    def to_json(self, accept_uncompared: bool = False) -> str:
        """Return the report as JSON.

        Args:
            accept_uncompared: whether functions that were not compared leave the verdict as it is.
        """
        return json.dumps(self.to_dict(accept_uncompared), ensure_ascii=False)

    def __str__(self) -> str:
        """Return the report as text."""
        return self.text()

    def text(self, accept_uncompared: bool = False) -> str:
        """Return the report as text; its last line is the verdict.

        Args:
            accept_uncompared: whether functions that were not compared leave the verdict as it is.
        """
        lines = [f"{self.title}: {self.states} states"]
        if self.functions or self.uncompared:
            rows = [*map(_cells, self.functions), *self._uncompared_rows()]
            lines += ["", *_table(("function", "", "largest error", "relative", "where"), rows)]
            for t in self.functions:
                if not t.agrees:
                    lines.append(f"worst {t.function}: at {t.worst_at(', ', 4)}")
                if t.note:
                    lines.append(f"{t.function}: {t.note}")
        if self.causes:
            lines += ["", "What is wrong", *chain.from_iterable(map(_lines_of, self.causes))]
        if self.differences:
            lines += ["", "Difference, model less robot", *self._difference_lines()]
        if self.laws:
            lines += ["", "Structural properties"]
            # Without its head: laws need none, but its widths are those of the rows.
            lines += _table(("", "", "error", ""), self._checked_laws())[1:]
        if self.notes:
            lines += ["", *(f"note: {note}" for note in self.notes)]
        return "\n".join([*lines, "", self.judge(accept_uncompared).line])

    def _difference_lines(self) -> list[str]:
        """Return the differences, equal ones in one line, and what their numbers are."""
        joined: dict[tuple[str, str], list[str]] = {}
        for one in self.differences:
            labels = joined.setdefault((one.function, one.told), [])
            labels.append(one.label)
        lines = [
            f"- {function}, {_few(tuple(labels))}: {text}" for (function, text), labels in joined.items()
        ]
        more = len(lines) - _LINES
        if more > 0:
            lines = [*lines[:_LINES], f"- and {more} more (all are in the JSON)"]
        return [*lines, *(f"    {text}" for text in self.symbols)]

    def _uncompared_rows(self) -> list[tuple[str, ...]]:
        """Return a row of the table for each function that was not compared."""
        taken = [each.function for each in self.functions]
        return [
            (name, "NOT COMPARED", "", "", propose_map(name, ARGUMENTS, taken)) for name in self.uncompared
        ]

    def _repr_html_(self) -> str:
        """Return functions, laws and causes as tables, for notebooks."""
        head = ("function", "", "largest error", "relative", "where")
        rows = [*(_cells(t, "differs") for t in self.functions), *self._uncompared_rows()]
        caption = f"{self.model}: {self.verdict()}"
        parts = [html_table(caption, head, rows)]
        if self.causes:
            parts.append(html_table("what is wrong", ("", "scope"), [(c.text, c.scope) for c in self.causes]))
        if self.laws:
            laws = [(law.name, law.verdict, law.text) for law in self.laws]
            parts.append(html_table("structural properties", ("property", "", "found"), laws))
        return "".join(parts)

    def verdict(self) -> str:
        """Return the result in one line."""
        return self.judge().line

    def _found(self) -> str:
        """Return what was found in what was compared."""
        if self.agrees:
            if not self.functions:
                done = "the model has every structural property that could be checked"
                return f"{done}; its values were not compared: give its robot (--robot)"
            return "the model agrees"
        differ = [t.function for t in self.functions if not t.agrees]
        if self.numbers_only and not differ:
            names = ", ".join(self.numbers_only)
            return (
                f"the model agrees for these numbers only: with another {names} it would differ from the "
                "robot (two quantities of the same value may be in each other's place)"
            )
        if differ:
            return f"the model differs in {', '.join(differ)}"
        failing = ", ".join(law.name for law in self.laws if law.verdict == "fails")
        return f"structural properties fail: {failing}"

    def html(self, accept_uncompared: bool = False) -> str:
        """Return the report as a page of its own, without scripts and without anything from elsewhere.

        Args:
            accept_uncompared: whether functions that were not compared leave the verdict as it is.
        """
        from armgpi.viewing import page  # it imports what draws, which text needs not

        sections = {}
        if self.functions:
            rows = [
                (
                    t.function + "(" + ", ".join(ARGUMENTS[t.function]) + ")",
                    "agrees" if t.agrees else "differs",
                    f"{t.max_abs:.3g}",
                    f"{t.max_rel:.3g}",
                    ", ".join(t.differing),
                    t.worst_at("; ", 5),
                )
                for t in self.functions
            ]
            columns = ("function", "", "largest error", "relative", "where", "worst at")
            sections["Functions"] = _html_table("functions", columns, rows, words=(1, 4, 5))
        if self.causes:
            sections["What is wrong"] = "".join(_html_cause(cause) for cause in self.causes)
        if self.differences:
            sections["Difference, model less robot"] = _html_differences(self)
        if self.laws:
            laws = ("property", "", "error", "")
            sections["Structural properties"] = _html_table(
                "structural properties", laws, self._checked_laws(), words=(1, 3)
            )
        if self.notes:
            sections["Notes"] = page.bullets(self.notes)
        if self.uncompared:
            lines = [f"{name}: {proposal}" for name, *_, proposal in self._uncompared_rows()]
            sections["Not compared"] = page.bullets(lines)
        verdict = self.judge(accept_uncompared)
        line = f"<p class={verdict.page_class}>{page.text(verdict.line)}</p>"
        return page.document(self.title, line, sections)

    def markdown(self) -> str:
        """Return the report as Markdown."""
        lines = [f"# {self.title}", "", f"**{self.verdict()}**", ""]
        if self.functions:
            lines += ["| function | | largest error | relative | where |", "|---|---|---|---|---|"]
            lines += [f"| {' | '.join(_cells(t))} |" for t in self.functions]
            lines += [f"| {' | '.join(row)} |" for row in self._uncompared_rows()]
        for cause in self.causes:
            first, *rest = _lines_of(cause)
            lines += ["", first]
            lines += [f"  - `{x}`" if _is_code(x) else f"  - {x}" for x in map(str.strip, rest)]
            lines += [f"  - {label}: ${math}$" for label, math in _formulas(cause, typeset.tex)]
        if self.differences:
            lines += ["", "| difference | where | what | model less robot |", "|---|---|---|---|"]
            lines += [_difference_row(one) for one in self.differences]
            lines += ["", *(f"- {text}" for text in self.symbols)]
        if self.laws:
            lines += ["", "| property | | error | |", "|---|---|---|---|"]
            lines += [f"| {' | '.join(row)} |" for row in self._checked_laws()]
        return "\n".join([*lines, *(f"\n{note}" for note in self.notes)]) + "\n"

    def latex(self) -> str:
        """Return the report as LaTeX with amsmath: a table of the functions, and a list of what is wrong."""
        rows = [" & ".join(map(latex_text, _cells(t))) + r" \\" for t in self.functions]
        lines = [rf"\paragraph{{{latex_text(self.model)}}} {latex_text(self.verdict())}."]
        lines += [r"\begin{tabular}{lllll}", *rows, r"\end{tabular}"] if rows else []
        if self.causes:
            lines += [r"\begin{itemize}"]
            for cause in self.causes:
                told = [latex_text(line.strip().removeprefix("- ")) for line in _lines_of(cause)]
                told += [rf"{latex_text(label)}: ${math}$" for label, math in _formulas(cause, typeset.tex)]
                lines.append(r"\item " + r" \\ ".join(told))
            lines += [r"\end{itemize}"]
        formulas = [(one, math) for one in self.differences if (math := _tex_of(one)) is not None]
        if formulas:
            lines.append(r"\begin{itemize}")
            for one, math in formulas:
                lines.append(
                    rf"\item {latex_text(f'{one.function}, {one.label}: {one.text}')}: $\Delta = {math}$"
                )
            lines += [*(rf"\item {latex_text(text)}" for text in self.symbols), r"\end{itemize}"]
        return "\n".join(lines) + "\n"

    def _checked_laws(self) -> list[tuple[str, ...]]:
        return [
            (law.name, law.verdict, "" if math.isnan(law.error) else f"{law.error:.1g}", law.text)
            for law in self.laws
        ]


def _cells(t: FunctionReport, differs: str = "DIFFERS") -> tuple[str, ...]:
    """Return a function's row of a table."""
    verdict = "agrees" if t.agrees else differs
    return (t.function, verdict, f"{t.max_abs:.2g}", f"{t.max_rel:.2g}", _few(t.differing))


def _tex_of(one: Difference) -> str | None:
    """Return a difference as LaTeX, None where it has no short formula."""
    return typeset.tex(one.formula) if one.formula else None


def _difference_row(one: Difference) -> str:
    """Return a difference as a row of a table in Markdown."""
    math = _tex_of(one)
    return f"| {one.function} | {one.label} | {one.told} | {'' if math is None else f'${math}$'} |"


def _html_differences(report: DynamicsReport) -> str:
    """Return the differences as a list with formulas, and what their numbers are."""
    from armgpi.viewing import page

    items = []
    for one in report.differences:
        math = typeset.mathml(one.formula) if one.formula else None
        text = page.text(f"{one.function}, {one.label}: {one.told}")
        items.append(f"<li>{text}{'' if math is None else f'<br>Δ = {math}'}</li>")
    return f"<ul>{''.join(items)}</ul>" + (page.bullets(report.symbols) if report.symbols else "")


def _lines_of(cause: Cause) -> list[str]:
    """Return a cause as lines of text."""
    where = ", ".join(cause.functions)
    if cause.scope != "model":  # a mistake of the whole arm shows everywhere
        labels = _few(tuple(dict.fromkeys(element.label for element in cause.elements)))
        where += f"{', ' if len(cause.functions) == 1 else ': '}{labels}"
    worth = f"{'formula' if cause.structural else 'value'}, {'confirmed' if cause.confirmed else 'suggested'}"
    kind = "" if cause.kind in _WITHOUT_WORTH else f" [{worth}]"
    lines = [f"- {f'{where}: ' if where else ''}{cause.text}{kind}"]
    lines += [f"    {cause.beside}"] if cause.beside else []
    lines += [f"    or: {text}" for text in cause.alternatives]
    lines += [f"    {line}" for line in cause.evidence]
    return lines


def _formulas(cause: Cause, form: Callable[[str], str | None]) -> list[tuple[str, str]]:
    """Return the formulas of a cause that can be set in a form, with their labels."""
    found = ((label, form(code)) for label, code in cause.formulas)
    return [(label, math) for label, math in found if math is not None]


def _html_cause(cause: Cause) -> str:
    """Return a cause as HTML, its formulas set."""
    from armgpi.viewing import page

    first, *rest = _lines_of(cause)
    parts = [f"<p>{page.text(first.removeprefix('- '))}</p>"]
    if formulas := _formulas(cause, typeset.mathml):
        lines = (f"<p>{page.text(label)}: &nbsp; {math}</p>" for label, math in formulas)
        parts.append(f"<div class=scroll tabindex=0 role=region aria-label=formulas>{''.join(lines)}</div>")
    shown: list[str] = []
    before = ""
    for line in map(str.strip, rest):
        code = f"<code>{_mark_change(before, line)}</code>" if _is_code(line) else page.text(line)
        shown.append(f"<li>{code}</li>")
        before = line if _is_code(line) else ""
    return "".join([*parts, f"<ul>{''.join(shown)}</ul>" if shown else ""])


def _is_code(line: str) -> bool:
    """Tell whether a line of a cause is one of the model's source, with its number."""
    number, colon, _ = line.strip().partition(": ")
    return bool(colon) and number.isdigit()


def _mark_change(before: str, line: str) -> str:
    """Return a line of source as HTML; what the line before has otherwise is marked."""
    from armgpi.viewing import page

    if before.split(":")[0] != line.split(":")[0]:
        return str(page.text(line))
    plain = line.split("   <- ")[0]
    start = _common_length(before, plain)
    end = _common_length(before[start:][::-1], plain[start:][::-1])
    parts = (line[:start], line[start : len(plain) - end], line[len(plain) - end :])
    head, middle, tail = map(page.text, parts)
    return f"{head}<mark>{middle}</mark>{tail}"


def _common_length(one: str, other: str) -> int:
    """Return how many characters two texts begin with alike."""
    pairs = zip(one, other, strict=False)
    return next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def _few(labels: tuple[str, ...]) -> str:
    """Join labels, shortening a long list."""
    more = len(labels) - _LISTED
    return ", ".join(labels[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def _plain(cause: Cause) -> dict[str, Any]:
    """Return a cause as plain data."""
    return {
        **cause._asdict(),
        "elements": [
            {"function": e.function, "label": e.label, "quantity": e.quantity, "index": list(e.place)}
            for e in cause.elements
        ],
    }


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows as lines with aligned columns."""
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    return ["  ".join(x.ljust(w) for x, w in zip(row, widths, strict=True)).rstrip() for row in [head, *rows]]


def _html_table(
    label: str, head: tuple[str, ...], rows: Sequence[tuple[str, ...]], words: tuple[int, ...]
) -> str:
    """Return a table whose rows are marked where the second cell says that something is wrong."""
    from armgpi.viewing import page

    classes = ["bad" if row[1] in ("differs", "fails") else "" for row in rows]
    return page.table(head, rows, label=label, classes=classes, words=words)
