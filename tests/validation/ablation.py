"""What each mechanism of the search is worth: the names lost without it, on mistakes drawn at random.

Of every style of :mod:`byhand` but those set aside, a few mistakes are drawn and validated. Those that are
named rightly are validated again with one mechanism switched off at a time, where it may have named them: an
edit of the source of that kind, or a hypothesis for what was named by the values alone. A short search
(`SECONDS`) keeps it affordable, so that a few more names are lost than with the full time.

python tests/validation/ablation.py [MISTAKES_OF_EACH_STYLE [SEED [PROCESSES [STYLE ...]]]]
"""

from __future__ import annotations

import inspect
import io
import sys
import tempfile
import tokenize
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import byhand
import numpy as np
import scoring

from armgpi import validate
from armgpi.validation import (
    alternatives,
    course,
    diagnose,
    edits,
    graph,
    harmonics,
    hypotheses,
    mechanics,
    repair,
    residual,
    search,
    slips,
    summands,
    terms,
    typed,
    witnesses,
    worker,
)
from armgpi.validation.diagnose import UNNAMED

#: Time of the processor of one search of the source [s]; half a second where the values alone name.
SECONDS, BY_VALUES = 6.0, 0.5
#: Styles whose models take a minute each.
SLOW = ("articulated", "craig", "dh6", "turned")


class Case(NamedTuple):
    """A mistake that was validated: whether its name is right, and what named it.

    Attributes:
        style: of the model.
        line: in the list of mistakes.
        right: whether the name is right.
        confirmed: whether it is confirmed.
        kinds: of all causes.
        repaired: whether a change of the source named it.
        statement: whether a forgotten statement did.
    """

    style: str
    line: int
    right: bool
    confirmed: bool
    kinds: tuple[str, ...]
    repaired: bool
    statement: bool

    @property
    def drawn(self) -> bool:
        """Whether the model has expressions of SymPy or CasADi."""
        return any(f"import {name}" in byhand.source(self.style) for name in ("sympy", "casadi"))


class Mechanism(NamedTuple):
    """A part of the search.

    Attributes:
        name: for the table.
        switches: what is put in place of what: module or class, its attribute, and the other.
        concerns: whether it may have named a case.
        parts: what would be deleted without it, for its size.
    """

    name: str
    switches: tuple[tuple[Any, str, Any], ...]
    concerns: Callable[[Case], bool]
    parts: tuple[Any, ...]

    @property
    def tokens(self) -> int:
        """Return the tokens of its source, without comments and line ends."""
        left_out = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
        count = 0
        for part in self.parts:
            text = io.StringIO(inspect.cleandoc(inspect.getsource(part)))
            count += sum(token.type not in left_out for token in tokenize.generate_tokens(text.readline))
        return count


def _nothing(*_: Any, **__: Any) -> Iterator[Any]:
    yield from ()


def _none(*_: Any, **__: Any) -> None:
    return None


def _empty(*_: Any, **__: Any) -> list[Any]:
    return []


def _without(kind: str) -> Callable[..., Iterator[Any]]:
    """Return the alternatives of an expression without those of a kind."""
    every = alternatives.alternatives

    def few(*given: Any) -> Iterator[Any]:
        return (one for one in every(*given) if one[0] != kind)

    return few


def _edit(kind: str, *parts: Any) -> Mechanism:
    """Return the edits of one kind as a mechanism."""
    switches = ((edits, "alternatives", _without(kind)),)
    return Mechanism(f"edit: {kind}", switches, lambda case: case.repaired and kind in case.kinds, parts)


def _hypothesis(name: str, *makers: str) -> Mechanism:
    """Return hypotheses of the whole model as a mechanism."""
    switches = tuple((hypotheses, maker, _empty) for maker in makers)
    parts = tuple(getattr(hypotheses, maker) for maker in makers)
    return Mechanism(f"values: {name}", switches, _by_values, parts)


def _by_values(case: Case) -> bool:
    return not case.repaired


def _solved(case: Case) -> bool:
    return case.repaired and bool({"term", "value"} & {*case.kinds})


def _several(case: Case) -> bool:
    return case.repaired and len(case.kinds) > 1


def _as_it_is(functions: Any, again: Any, _: Any) -> Any:
    return again(functions.origin.source)


def _as_told(causes: Any, _: Any) -> Any:
    return causes


def _aside(problem: Any, *_: Any) -> Any:
    return witnesses._Aside(problem, None)


def _same(_: Any, found: Any, *__: Any) -> Any:
    return found


def mechanisms() -> list[Mechanism]:
    """Return what is switched off, one after the other."""
    trials, of = search._Trials, diagnose._Search
    return [
        _edit("sign", alternatives._negative),
        _edit("factor"),
        _edit("square"),
        _edit("trig"),
        _edit("angle", alternatives._of_angle, alternatives._absolute),
        _edit("degrees"),
        _edit("extra"),
        _edit("sum", alternatives._of_assigned),
        _edit("product", alternatives._of_arrays, alternatives._without_factor),
        _edit("transposed", alternatives._transposed),
        _edit("cross"),
        _edit("swapped", alternatives._of_row),
        _edit("name", alternatives._of_own),
        _edit("index", alternatives.indices, alternatives._shifted, alternatives._shifted_slices),
        _edit("term", alternatives._of_products, alternatives._with_unused, alternatives._siblings),
        Mechanism(
            "terms that are solved for",
            ((trials, "_fits", _nothing),),
            _solved,
            (trials._fits, trials._solve, trials._root, trials._groups, search._missing_terms),
        ),
        Mechanism(
            "vectors that are missing",
            ((trials, "_vector_picks", _nothing),),
            _solved,
            (trials._vector_picks, alternatives.vector_terms, alternatives._spatial_terms),
        ),
        Mechanism(
            "forgotten statements",
            ((edits.Block, "_with_forgotten", _nothing),),
            lambda case: case.statement,
            (edits.Block._with_forgotten, edits._beginnings),
        ),
        Mechanism(
            "parts of functions",
            ((trials, "_helpful_in_parts", _nothing),),
            lambda case: case.repaired and "inverse_dynamics" in byhand.source(case.style),
            (trials._helpful_in_parts, repair._parts),
        ),
        Mechanism("one change after the other", ((search, "_go_on", _none),), _several, (search._go_on,)),
        Mechanism("pairs by effect", ((trials, "pairs", _nothing),), _several, (trials.pairs,)),
        Mechanism(
            "pairs that are tried", ((trials, "tried_pairs", _nothing),), _several, (trials.tried_pairs,)
        ),
        Mechanism(
            "graph in SymPy's place",
            ((worker, "_as_graph", _as_it_is),),
            lambda case: case.repaired and case.drawn,
            (graph,),
        ),
        Mechanism(
            "its mechanics",
            ((mechanics, "NAMES", {}),),
            lambda case: case.repaired and case.style == "mechanics",
            (mechanics,),
        ),
        Mechanism(
            "slips: overwritten",
            ((witnesses, "overwritten", _nothing),),
            lambda case: "overwritten" in case.kinds,
            (slips.overwritten, slips._whole_lines),
        ),
        Mechanism(
            "slips: everywhere",
            ((witnesses, "everywhere", _nothing),),
            lambda case: "everywhere" in case.kinds,
            (slips.everywhere, slips._swapped, slips._alike, slips._partners),
        ),
        Mechanism(
            "wrong numbers",
            ((witnesses, "_wrong_number", _none),),
            lambda case: case.repaired and "value" in case.kinds,
            (typed.find_wrong_number, typed._Search, typed._nearest_share, typed.typed_numbers),
        ),
        Mechanism(
            "confirmed by the difference's terms",
            ((repair, "confirmed_by_terms", _same),),
            lambda case: case.repaired and bool({"sign", "factor"} & {*case.kinds}),
            (repair.confirmed_by_terms,),
        ),
        Mechanism(
            "the difference as the name", ((witnesses, "_told_by_values", _as_told),), _by_values, (residual,)
        ),
        Mechanism(
            "neglected inertias", ((witnesses, "_neglected", _aside),), _by_values, (witnesses._neglected,)
        ),
        Mechanism("rounded gravity", ((witnesses, "_rounded", _aside),), _by_values, (witnesses._rounded,)),
        Mechanism(
            "another parameter set",
            ((witnesses, "_with_other_bodies", lambda _, values: values),),
            _by_values,
            (witnesses._with_other_bodies, summands.fits_other_bodies),
        ),
        Mechanism("values: terms of the robot", ((terms, "fits", _empty),), _by_values, (terms,)),
        Mechanism(
            "values: slips of trigonometry", ((of, "slips", _empty),), _by_values, (of.slips, harmonics.slip)
        ),
        Mechanism("values: one number", ((diagnose, "parameters", _empty),), _by_values, (diagnose._Fitted,)),
        Mechanism(
            "values: gravity", ((of, "gravity", _empty),), _by_values, (of.gravity, diagnose._other_gravity)
        ),
        Mechanism("values: a factor", ((of, "common_factor", _empty),), _by_values, (of.common_factor,)),
        Mechanism("values: copied entries", ((of, "copies", _nothing),), _by_values, (of.copies,)),
        Mechanism(
            "values: angles of an entry",
            ((diagnose, "angle_maps", _empty),),
            _by_values,
            (hypotheses.angle_maps,),
        ),
        _hypothesis("signs and zeros of joints", "_signs", "_zeros"),
        _hypothesis("degrees", "_degrees"),
        _hypothesis("order of joints", "_orders"),
        _hypothesis("absolute angles", "_absolute"),
        _hypothesis("bodies", "_bodies"),
        _hypothesis("frames", "_frames"),
        _hypothesis("lengths", "_lengths"),
        _hypothesis("C and H", "_structure"),
    ]


def judged(style: str, line: int, name: str = "", by_values: bool = False) -> Case:
    """Validate one mistake, without the mechanism of a name."""
    mistake = next(one for one in byhand.mistakes(style) if one.line == line)
    seconds = BY_VALUES if by_values else SECONDS
    off = [one.switches for one in mechanisms() if one.name == name]
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        for place, attribute, other in (
            (course, "TOTAL", seconds),
            *sum(off, ()),
        ):
            stack.enter_context(mock.patch.object(place, attribute, other))
        kept: list[Any] = []

        def keeping(*given: Any, **more: Any) -> Any:
            kept.append(validate(*given, **more))
            return kept[-1]

        stack.enter_context(mock.patch.object(byhand, "validate", keeping))
        outcome = byhand.outcome(mistake, Path(folder))
    print(style, line, name, outcome.right, file=sys.stderr, flush=True)
    causes = [cause for cause in kept[0].causes if cause.kind not in UNNAMED]
    return Case(
        style,
        line,
        outcome.right,
        outcome.confirmed,
        tuple(cause.kind for cause in causes),
        bool(causes) and causes[0].line is not None,
        "(a statement)" in outcome.text,
    )


def drawn(count: int, seed: int, styles: Sequence[str]) -> list[tuple[str, int]]:
    """Return mistakes of every style, or of some, at random, but for those that are set aside."""
    left_out, found = byhand.aside(), []
    for style in styles or sorted({*byhand.STYLES, *byhand.LATER} - {*byhand.NINTH, *byhand.TENTH, *SLOW}):
        lines = [m.line for m in byhand.mistakes(style) if (style, m.line) not in left_out]
        chosen = np.random.default_rng([seed, *style.encode()]).permutation(lines)[:count]
        found += [(style, int(line)) for line in sorted(chosen)]
    return found


def main(count: int = 2, seed: int = 5808, processes: int = 2, *, styles: Sequence[str] = ()) -> None:
    """Print the table."""
    with ProcessPoolExecutor(processes) as pool:
        first = [pool.submit(judged, *one) for one in drawn(count, seed, styles)]
        cases = [one.result() for one in first]
        right = [case for case in cases if case.right]
        print(f"right with all: {scoring.share(len(right), len(cases))}\n", flush=True)
        print(
            "| mechanism | tokens | may have named | names lost | confirmed no more |\n|---|---|---|---|---|"
        )
        waiting = []
        for one in mechanisms():
            mine = [case for case in right if one.concerns(case)]
            waiting.append(
                [
                    (case, pool.submit(judged, case.style, case.line, one.name, not case.repaired))
                    for case in mine
                ]
            )
        for one, pairs in zip(mechanisms(), waiting, strict=True):
            after = [(case, future.result()) for case, future in pairs]
            lost = [case for case, again in after if not again.right]
            unsure = sum(case.confirmed and again.right and not again.confirmed for case, again in after)
            where = ", ".join(f"{case.style} {case.line}" for case in lost)
            print(
                f"| {one.name} | {one.tokens} | {len(pairs)} | {len(lost)} | {unsure} | {where}", flush=True
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]), styles=sys.argv[4:])
