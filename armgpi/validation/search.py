"""The search for changes of a model's source with which it agrees: one, two at once, one after the other.

Every single change of :mod:`armgpi.validation.edits` is tried. What a missing term has to be is solved for,
and looked up among the products of the model's own names: a fit with a dictionary. Where one change
brings values into agreement and spoils none, it is made in a copy of the source, and the search goes on with
that copy. Two changes of which neither does so alone are found where their effects add up to what differs, or
by trying pairs. The shortest description wins.

This runs in the worker (:mod:`armgpi.validation.worker`), beside the model.
"""

from __future__ import annotations

import ast
import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.alternatives import function_name, is_sum, with_part
from armgpi.validation.dictionary import Dictionary
from armgpi.validation.edits import (
    ALL,
    GRAVITY,
    ROWS,
    Block,
    Change,
    Editor,
    Goal,
    Pick,
    Site,
    apply_changes,
    impatient,
)
from armgpi.validation.graph import joint_of
from armgpi.validation.models import POSITIONS, Functions
from armgpi.validation.probes import RAISES, UNKNOWN, Probes
from armgpi.validation.proofs import Again, Proofs, Repaired, Searched
from armgpi.validation.units import USUAL

#: Share of the time for single changes and two at once; the rest is for what brings some into agreement.
_SINGLE_SHARE = 0.6
#: Share of it for a model of which each trial derives the equations of motion anew.
_SLOW_SHARE = 0.7
#: What is searched, in this order, as it is said where the time does not suffice.
_STAGES = ("usual changes", "terms and factors", "statements")
_SEVERAL, _PAIRS = "one change after the other", "pairs of changes"
#: A model that takes longer to be read is not read with other numbers where it agrees [s].
_READ = 0.1
#: Changes that are made at most: nobody believes a report of more.
MOST = 3
#: Changes with which the search goes on, where none makes all agree.
_BEAM = 3
#: Share of the time in which the search goes on with the changes that are tried fast.
_FIRST = 0.2
#: Repairs that agree at the numbers of the file alone, of which the best is taken.
_DOUBTED = 100
#: Of those that hold for other numbers but may not be the only ones.
_UNSURE = 6
#: Configurations at which changes are tried first.
_FEW = 2
#: Alternatives of a model whose functions take longer than this are looked at, many in one run [s].
_LOOKED_AT = 1e-4
#: Least time for a better change behind one that makes all agree [s]; else as long as that one took.
_BEHIND_GOOD = 0.5
#: Kinds of changes: to say which one it is costs their logarithm.
_KINDS = 14
#: Kinds of changes of which there are few at a place.
_USUAL = frozenset(
    [
        *("sign", "factor", "square", "trig", "angle", "degrees", "extra", "sum", "transposed", "cross"),
        *("swapped", "unit", "value", "name", "index", "operator", "inverse"),
    ]
)
#: Change of a term that shows what it moves: large enough for the digits, small enough for what is curved.
_NUDGE = 1e-4
#: A value that a term moves by less than this share of what it moves most is not moved.
_STILL = 1e-6
#: Steps by which a value is found: a length that is a thousand times too large takes ten to come near.
_STEPS = 24
#: Steps after which a root is as good as the digits of the model allow, once it is near.
_REFINED = 3
#: A root of a square is neared to a quarter of the way at each step; what is left of more has no root.
_SLOW = 0.7
#: A change with at most this effect moves nothing: effects are in a thousand times the tolerance.
_NO_EFFECT = 1e-3
#: Effects beyond this are those of a change that divides by next to nothing.
_HUGE = 1e12
#: Entries of a vector in all passes of a loop, at most, and terms that are tried where it is not linear.
_MOST_STEPS, _GUESSES = 60, 100
#: Time that it takes to list the terms of a vector's equation [s].
_LISTED = 0.3
#: A digit of a number costs so many bits.
_DIGIT_BITS = 3.32

Wrong = Mapping[str, Any]


def find_repair(
    functions: Functions, again: Again, goal: Goal, known: Sequence[float], seconds: float
) -> Searched:
    """Look for the changes with which a model gives what it should.

    Args:
        functions: the model's, with the file that they come from.
        again: reads the functions out of another text of that file.
        goal: what the functions should give.
        known: numbers that are hardly the wrong ones, as the robot has them too.
        seconds: time of the processor that it may take [s].
    """
    assert functions.origin is not None
    start = time.process_time()
    editor = Editor(functions.origin, goal, known)
    is_slow = editor.is_slow()
    # Of a slow model what is named is named early: the rest of the time would go to ever longer changes.
    until = start + (_SLOW_SHARE if is_slow else _SINGLE_SHARE) * seconds
    trials = _Trials(editor, again, until, MOST, known)
    best, steps = _search_stages(trials, known, MOST)
    if best is not None:
        return Searched(best, tuple(trials.unsearched))
    # What brings some of it into agreement deserves time of its own, but where each trial takes long.
    late = until if is_slow else start + seconds
    best = _go_on(trials, steps, known, MOST, late)
    if best is None:
        if time.process_time() > late:
            trials.unsearched += [_SEVERAL] if steps else []
        trials.extend(late)
        best = trials.first_that_agrees(trials.tried_pairs())
        if trials.is_over():
            trials.unsearched.append(_PAIRS)
    return Searched(best, tuple(trials.unsearched))


def _find_rest(
    functions: Functions, again: Again, goal: Goal, known: Sequence[float], until: float, most: int
) -> Repaired | None:
    """Return at most some further changes of a source that was changed already, None when none are found."""
    assert functions.origin is not None
    trials = _Trials(Editor(functions.origin, goal, known), again, until, most, known)
    best, steps = _search_stages(trials, known, most)
    if best is not None or most == 1:
        return best
    return _go_on(trials, steps, known, most, until)


def vary_numbers(functions: Functions, again: Again, goal: Goal) -> Repaired | None:
    """Return a source as it is, with what its numbers are in the robot; None where that takes too long."""
    assert functions.origin is not None
    start = time.process_time()
    again(functions.origin.source)
    if time.process_time() - start > _READ:
        return None  # it is read twice for every number
    source = functions.origin.source
    return Proofs(source, again, goal, ()).with_doubts(Repaired((), source))


def _search_stages(trials: _Trials, known: Sequence[float], most: int) -> tuple[Repaired | None, list[_Step]]:
    """Return the best repair by one change or two at once, and what helps at all, the best first."""
    best: Repaired | None = None
    steps: list[_Step] = []
    for k, steps in enumerate(trials.stages()):
        one = trials.first_that_agrees((step.pick,) for step in steps if not step.left)
        if most > 1 and not trials.is_short(one):
            one = _shorter(one, trials.first_that_agrees(trials.pairs()))
        if one is not None:
            best = min(best or one, one, key=lambda x: x.rank)
            if not best.doubts:
                break
        elif most > 1 and k == 0:
            best = _go_on(trials, steps, known, most, trials.share(_FIRST))
    return best, steps


def _go_on(
    trials: _Trials, steps: list[_Step], known: Sequence[float], most: int, until: float
) -> Repaired | None:
    """Return the shortest repair that begins with one of the best changes, None when there is no time."""
    best: Repaired | None = None
    for k, step in enumerate(steps[:_BEAM]):
        now, pick = time.process_time(), step.pick
        if now > until or (best is not None and pick.bits + 0.5 * trials.usual > best.bits):
            continue  # it cannot be shorter
        if made := trials.build((pick,)):
            share = (until - now) / (min(len(steps), _BEAM) - k)
            rest = _find_rest(made[1], trials.again, trials.editor.goal, known, now + share, most - 1)
            if rest is not None:
                changes = (*made[0].changes, *_before(rest.changes, made[0].changes[0]))
                best = _shorter(best, trials.without_idle(rest._replace(changes=changes)))
                if trials.is_short(best):
                    break
    return best


def _shorter(one: Repaired | None, other: Repaired | None) -> Repaired | None:
    """Return the repair of the shorter description, of two that may be none."""
    return min((x for x in (one, other) if x is not None), key=lambda x: x.rank, default=None)


def _before(changes: tuple[Change, ...], first: Change) -> Iterator[Change]:
    """Yield changes of a changed source with the lines that they had before the first change."""
    begins, _, ends, _ = first.span
    gone = ends - begins - first.new.count("\n")
    for change in changes:
        line, start, last, end = change.span
        shift = gone if line > begins else 0
        yield change._replace(span=(line + shift, start, last + shift, end))


class _Step(NamedTuple):
    """A change that brings values into agreement and spoils none, and how many still differ then."""

    left: int
    ugly: bool
    bits: float
    pick: Pick

    def is_like(self, other: Pick) -> bool:
        """Tell whether this makes all agree, and another is the same by another text."""
        one = self.pick
        if self.left or one.values is None or other.values is None:
            return False
        at_same = (one.block, one.site) == (other.block, other.site)
        return at_same and next(iter(one.values.values())) is next(iter(other.values.values()))


class _Tried(NamedTuple):
    """Changes of one kind, each made when asked for, and what they change at one state, (changes, m)."""

    kind: str
    at: Callable[[int], Pick]
    effects: Mapping[str, Array]


class _Trials:
    """Everything that is tried on one source."""

    def __init__(self, editor: Editor, again: Again, until: float, most: int, known: Sequence[float]) -> None:
        """Take a source with its switches, what reads a changed one, when to give up [s], most changes, ...

        ... and numbers that the robot has.
        """
        self.editor, self.again, self._until = editor, again, until
        self.proofs, self._goal = Proofs(editor.source, again, editor.goal, known), editor.goal
        self._doubted = _DOUBTED if most == MOST else 40
        self._targets, self._blocks = editor.targets, editor.blocks
        #: Changes that touch nothing that agrees, and were not looked at part by part yet.
        self._inside: list[Pick] = []
        self._sites = max(sum(len(block.sites) for block in self._blocks), 1)
        #: What two changes of the usual kinds take: what is longer has to be compared with others [bits].
        self.usual = 2.0 * float(np.log2(self._sites * _KINDS))
        self._tried: list[_Tried] = []
        self._proved: dict[Any, Repaired | None] = {}
        #: What the time did not suffice for.
        self.unsearched: list[str] = []
        self._outputs: dict[Any, dict[str, Array] | None] = {}
        start, names = time.process_time(), [name for name, x in editor.targets.items() if x.whole]
        editor.outputs(names, ROWS)
        #: Whether a run takes so long that alternatives are looked at, many in one run.
        self._is_looked_at = time.process_time() - start > _LOOKED_AT * ROWS * len(names)
        self._start = editor.outputs(editor.targets, ROWS) or {}
        self._probes = Probes(editor, self._start)
        self._wrong = {name: self._goal.away(name, x).any(axis=0) for name, x in self._start.items()}

    def is_short(self, one: Repaired | None) -> bool:
        """Tell whether a repair holds and is no longer than two usual changes: others need not be tried."""
        return one is not None and not one.doubts and one.bits <= self.usual

    def build(self, picks: Sequence[Pick]) -> tuple[Repaired, Functions] | None:
        """Return changes as text with the functions that they make, None when the source then fails."""
        changes = tuple(self.editor.change(pick) for pick in picks)
        source = apply_changes(self.editor.source, changes)
        try:
            with impatient():
                return Repaired(changes, source), self.again(source)
        except BaseException:  # a name that is not there yet, or a module that never ends
            return None

    def first_that_agrees(self, found: Iterable[Sequence[Pick]]) -> Repaired | None:
        """Return the first changes that make a copy of the source agree, for other numbers too.

        Where none does for other numbers, the one of the first few that has the fewest doubts.
        """
        best, count = None, 0
        for picks in found:
            before = len(self._proved)
            one = self.prove(picks)
            best, count = _shorter(best, one), count + (one is not None and len(self._proved) > before)
            if one is not None and one.holds and (one.sure or count >= _UNSURE):
                break
            if count == self._doubted or (best is not None and self.is_over()):
                break
        return best

    def prove(self, picks: Sequence[Pick]) -> Repaired | None:
        """Return changes with which a copy of the source agrees, and for how many numbers it does not."""
        key = tuple((id(pick.block), pick.site, pick.choice, pick.new) for pick in picks)
        if key not in self._proved:
            self._proved[key] = None
            changes = tuple(self.editor.change(pick) for pick in picks)
            repair = Repaired(changes, apply_changes(self.editor.source, changes))
            if self.proofs.agrees(repair.source):
                self._proved[key] = self.proofs.with_doubts(repair)
        return self._proved[key]

    def without_idle(self, repair: Repaired) -> Repaired:
        """Return a repair without the changes that it does not need: what came first may be undone later."""
        for change in repair.changes if len(repair.changes) > 1 else ():
            fewer = Repaired(tuple(one for one in repair.changes if one is not change), "")
            fewer = fewer._replace(source=apply_changes(self.editor.source, fewer.changes))
            if self.proofs.agrees(fewer.source):
                return self.without_idle(self.proofs.with_doubts(fewer))
        return repair

    def is_over(self) -> bool:
        """Tell whether the time has passed."""
        return time.process_time() > self._until

    def extend(self, until: float) -> None:
        """Allow time up to a moment on the clock of the process [s]."""
        self._until = max(self._until, until)

    def _off(self, outputs: Mapping[str, Array]) -> Wrong:
        return {name: self._goal.away(name, values).any(axis=0) for name, values in outputs.items()}

    def _matters(self, off: Wrong) -> bool:
        """Tell whether something differs that makes a model wrong."""
        targets = self._targets
        return any(w.any() and targets[n].whole for n, w in off.items())

    def stages(self) -> Iterator[list[_Step]]:
        """Yield the changes that make all agree, else those that make the most agree, the best first.

        What is tried fast comes before what takes long: the later lists have all of the earlier ones.
        """
        if not self._start:
            return
        picks = self._picks()
        usual = [pick for pick in picks if _is_usual(pick)]
        others = [pick for pick in picks if not _is_usual(pick)]
        found: dict[Any, _Step] = {}
        for what, stage in zip(
            _STAGES,
            (
                (self._helpful(usual, first=True), self._helpful_in_parts(), self._fits()),
                (
                    self._helpful(others, first=True),
                    self._helpful(picks, first=False),
                    self._helpful_in_parts(),
                ),
                (self._fits(statements=True),),
            ),
            strict=True,
        ):
            step: _Step | None = None
            begun, late = time.process_time(), math.inf
            for pick in itertools.chain(*stage):
                if time.process_time() > late:
                    break
                if step is not None and step.is_like(pick):
                    step, does = step._replace(bits=pick.bits, pick=pick), id(pick)
                else:
                    step, does = self._step(pick)
                if step is not None:
                    # Of those that do the same the shortest one.
                    found[does] = min(found.get(does, step), step, key=lambda one: one[:3])
                    repair = self._usual_repair(step)
                    if repair is not None and repair.holds:
                        break  # it agrees for other numbers too: what comes later is longer
                    if late == math.inf and repair is not None and not repair.doubts:
                        now = time.process_time()
                        late = now + max(now - begun, _BEHIND_GOOD)
            if self.is_over():
                self.unsearched.append(what)
            yield sorted(found.values(), key=lambda step: step[:3])

    def _usual_repair(self, step: _Step) -> Repaired | None:
        """Return a usual change that makes all agree, proved; None for any other one."""
        if step.left or step.ugly or step.pick.kind not in _USUAL:
            return None
        return self.prove((step.pick,))

    def _differing(self, reached: Iterable[str]) -> list[str]:
        """Return the functions that differ, of those that are reached, the fast ones of a graph first."""
        names = [n for n, w in self._wrong.items() if w.any() and n in reached and self._targets[n].whole]
        return sorted(names, key=self.editor.seconds)

    def _helpful(self, picks: list[Pick], first: bool) -> Iterator[Pick]:
        """Yield the changes that make values agree and spoil none, at the first state.

        Args:
            picks: all changes.
            first: look at the first function that differs; else at the others.
        """
        for pick in picks:
            if self.is_over():
                return
            differing = self._differing(pick.block.reaches)
            names = differing[:1] if first else differing[1:]
            if not names:
                continue
            outputs = self._outputs_of(pick, names)
            if outputs is None:
                continue
            if first:
                effects = {n: x[-1:] - self._start[n][len(x) - 1] for n, x in outputs.items()}
                self._tried.append(_Tried(pick.kind, [pick].__getitem__, effects))
            if self._helps(outputs):
                yield pick
            elif self._touches_wrong_alone(outputs):
                self._inside.append(pick)

    def _outputs_of(self, pick: Pick, names: Sequence[str]) -> dict[str, Array] | None:
        """Return what functions give at the first state with a change, None where they fail.

        What the change makes of its expression tells whether the model has to run for it.
        """
        rows = _rows_of(names)
        if not self._is_looked_at or _is_usual(pick):
            return self.editor.outputs_with(names, rows, pick)
        seen = [self._probes.of(pick, name, rows) for name in names]
        if any(other is RAISES for _, other in seen):
            return None
        if any(other is UNKNOWN for _, other in seen):
            return self.editor.outputs_with(names, rows, pick)
        if all(own == other for own, other in seen):
            return {name: self._start[name][:rows] for name in names}
        key = (id(pick.block), pick.site, *names, *(other for _, other in seen))
        if key not in self._outputs:
            self._outputs[key] = self.editor.outputs_with(names, rows, pick)
        return self._outputs[key]

    def _touches_wrong_alone(self, outputs: Mapping[str, Array]) -> bool:
        """Tell whether a change moves something, and nothing that agrees."""
        moved = any((x[-1] != self._start[name][len(x) - 1]).any() for name, x in outputs.items())
        return moved and not self._spoils(outputs)

    def _helpful_in_parts(self) -> Iterator[Pick]:
        """Yield the changes that make a part of a function agree and spoil no other, at the first state."""
        parts = [name for name, target in self._targets.items() if not target.whole]
        # Where much agrees, a change that spoils something shows it.
        parts.sort(key=lambda name: int(self._wrong[name].sum()))
        late, inside, self._inside = self.share(0.2), self._inside, []
        for pick in inside:
            if time.process_time() > late:
                return
            helps = False
            for name in (name for name in parts if name in pick.block.reaches):
                outputs = self.editor.outputs_with([name], 1, pick)
                if outputs is None or self._spoils(outputs):
                    helps = False
                    break
                helps = helps or self._helps(outputs)
            if helps:
                yield pick

    def share(self, share: float) -> float:
        """Return when a share of the time that is left has passed."""
        now = time.process_time()
        return now + share * (self._until - now)

    def _helps(self, outputs: Mapping[str, Array]) -> bool:
        """Tell whether some values agree that did not, and all that did."""
        off = self._off(outputs)
        return not self._spoils(outputs) and any((self._wrong[name] & ~off[name]).any() for name in off)

    def _spoils(self, outputs: Mapping[str, Array]) -> bool:
        """Tell whether some values differ that did not."""
        return any((off & ~self._wrong[name]).any() for name, off in self._off(outputs).items())

    def _step(self, pick: Pick) -> tuple[_Step | None, Any]:
        """Return how good a change is at all states, None when it does not help; and what it does."""
        whole = [name for name in pick.block.reaches if self._targets[name].whole]
        with self.editor.making(pick):
            outputs = self.editor.outputs(whole, ROWS)
            if outputs is not None and self._matters({**self._wrong, **self._off(outputs)}):
                outputs = self.editor.outputs(pick.block.reaches, ROWS)  # with the parts, which take long
        if outputs is None or not self._helps(outputs):
            return None, None
        off = {**self._wrong, **self._off(outputs)}
        left = sum(map(np.count_nonzero, off.values())) if self._matters(off) else 0
        of = self._targets
        does = tuple((x / (1e3 * of[n].tolerance)).round().tobytes() for n, x in sorted(outputs.items()))
        # Those with which all agree are kept: their sources are tried one after the other.
        return _Step(left, self._ugly(pick), pick.bits, pick), does if left else id(pick)

    def _ugly(self, pick: Pick) -> bool:
        """Tell whether a change is right by chance: for a symmetric arm, or in its product with v alone."""
        site = pick.block.sites[pick.site]
        negated = pick.kind == "sign" and isinstance(site.choices[pick.choice][1], ast.UnaryOp)
        if negated and pick.values is None and _has_joints(site.node):
            return True
        target = self._targets.get("coriolis_matrix")
        if target is None or target.best is None:
            return False
        with self.editor.making(pick):
            matrix = self.editor.matrix()
        size = max(float(np.abs(target.best[0]).max()), 1e-3)
        return matrix is None or bool(np.abs(matrix.ravel() - target.best[0]).max() > 1e-6 * size)

    def _picks(self) -> list[Pick]:
        """Return every change in what the functions that differ are made of, the usual kinds first."""
        found: list[Pick] = []
        differing = {name for name, w in self._wrong.items() if w.any()}
        for block in self._blocks:
            for k, site in enumerate(block.sites if block.reaches & differing else ()):
                found += self._picks_at(block, k)
                if site.whole and self._until - time.process_time() > _LISTED:
                    found += self._vector_picks(block, k)
        return sorted(found, key=lambda pick: pick.bits)

    def _picks_at(self, block: Block, k: int) -> Iterator[Pick]:
        """Yield every change at one place, but for terms that are solved for."""
        site = block.sites[k]
        kinds = [kind for kind, _ in site.choices]
        right = self.editor.is_right(site)  # but for its sign
        for c, kind in enumerate(kinds[: len(kinds) - site.fitted - site.whole]):
            if right and kind != "sign":
                continue
            # Terms come in the order of their length.
            rank = c + 1 - kinds.index(kind) if kind == "term" else kinds.count(kind)
            # A sign that is there is wrong sooner than one that is not.
            if kind == "sign":
                rank = rank + 1 if isinstance(site.choices[c][1], ast.UnaryOp) else 1
            # 2 (v1 + v2) v2 - v2² is 2 v1 v2 + v2²: a wrong sign is likelier than a rate that is forgotten.
            if kind == "angle" and isinstance(site.node, ast.Subscript):
                rank += 1
            yield Pick(block, k, c, self._bits(rank), None, kind)

    def _bits(self, rank: float) -> float:
        """Return the length of a description: which place, which kind, and which one of that kind."""
        return float(np.log2(self._sites * _KINDS * rank))

    def _output_with(self, pick: Pick, name: str) -> Array | None:
        """Return what a function gives at the first state with a change."""
        outputs = self.editor.outputs_with([name], 1, pick)
        return None if outputs is None else outputs[name][0]

    def _vector_picks(self, block: Block, k: int) -> Iterator[Pick]:
        """Yield vectors that may be missing in a sum: where it is linear, those with a right effect.

        In a loop a term has other values every time: what each entry moves is seen pass by pass.
        """
        choice, name = len(block.sites[k].choices) - 2, next(iter(self._differing(block.reaches)), None)
        old, seen = ast.unparse(block.sites[k].node), list[dict[str, Any]]()
        if name is None:
            return
        bare = Pick(block, k, choice, 0.0)
        start = self._output_with(bare._replace(call=partial(_keep, seen)), name)
        now = _at_every(compile(old, "<term>", "eval"), block.namespace, seen)
        if start is None or now.ndim != 2 or now.size > _MOST_STEPS:
            return
        steps = np.vstack([np.eye(now.size), np.ones(now.size)]).reshape(-1, *now.shape)
        picks = (bare._replace(call=partial(_next, iter(step))) for step in steps)
        effects = [x for pick in picks if (x := self._output_with(pick, name)) is not None]
        if len(effects) < len(steps):
            return
        linear, slope, rest = _linear([start, *effects])
        most, factors = (None, (1.0, -1.0, 2.0, -2.0)) if linear else (_GUESSES, (1.0, -1.0))
        fitting, values = _fitting_vectors(block, seen, now.shape, most)
        moves = values @ slope
        for factor in factors:

            def pick_at(k: int, factor: float = factor) -> Pick:
                place, text, code = fitting[k]
                sign, twice = "-" if factor < 0.0 else "", "2 * " if abs(factor) > 1.0 else ""
                # They come in the order of their length.
                new, bits = _sum(old, sign + twice + text), self._bits(abs(factor) * (2 * place + 2))

                def call(names: dict[str, Any]) -> Any:
                    return factor * eval(code, block.namespace, names)

                return bare._replace(bits=bits, kind="term", new=new, sure=linear, call=call)

            good = np.ones(len(moves))
            if linear:  # two of which each is wrong alone may add up
                effect = factor * moves
                self._tried.append(_Tried("term", pick_at, {name: effect}))
                # Some of the function agrees with it, and none is spoiled.
                lacking, wrong = self._targets[name].values[0] - start, self._wrong[name]
                moved, right = np.abs(effect) > rest, np.abs(effect - lacking) <= rest
                good = (moved & right & wrong).any(axis=1) & ~(moved & ~wrong).any(axis=1)
            yield from map(pick_at, np.flatnonzero(good).tolist())

    # Terms that are solved for.

    def _fits(self, statements: bool = False) -> Iterator[Pick]:
        """Yield terms that are missing, or statements: what each has to be is solved for, and looked up."""
        for block in sorted(self._blocks, key=lambda b: not b.rebuilds):  # constants are found fast
            if not block.once or len(block.calls.get(ALL, ())) < ROWS:
                continue
            for k, site in enumerate(block.sites):
                if not site.fitted or bool(site.statement) != statements:
                    continue
                if not self.is_over() and not self.editor.is_right(site):
                    yield from self._solve(block, k)

    def _solve(self, block: Block, k: int) -> Iterator[Pick]:
        """Yield the terms with which some values agree and none is spoiled, by their texts."""
        site = block.sites[k]
        pick = Pick(block, k, len(site.choices) - 1, 0.0, {ALL: np.zeros(ROWS)})
        constant = self.editor.is_constant(block, k)
        reached = block.reaches if block.rebuilds else block.reaches & block.once_in
        names = [n for n in reached if self._targets[n].whole]
        differing = self._differing(names)
        if self._moves_what_agrees(pick, differing[:1]):
            return
        shown = differing[:1] if self.editor.drawn else differing  # to draw all of them takes long
        for used in self._groups(*self._slope(pick, shown, _FEW), constant):
            if (values := self._root(pick, used, constant)) is None:
                continue
            solved = pick._replace(values={ALL: values}, kind="value" if site.literal else "term")
            outputs = self.editor.outputs_with(names, ROWS, solved)
            if outputs is not None and self._helps(outputs):
                for text, bits in _missing_terms(block, site, values):
                    yield solved._replace(bits=float(bits + self._bits(1)), new=text)
                return

    def _moves_what_agrees(self, pick: Pick, names: Sequence[str]) -> bool:
        """Tell whether a term moves values that agree: then no value of it leaves them."""
        slopes, _ = self._slope(pick, names, _rows_of(names))
        sizes = {name: np.abs(slope).max(axis=0) for name, slope in slopes.items()}
        return any(
            (size[~self._wrong[name]] > _STILL * size.max(initial=0.0)).any() for name, size in sizes.items()
        )

    def _groups(self, slope: Mapping[str, Array], rest: Mapping[str, Array], constant: bool) -> list[Wrong]:
        """Return which values may be wrong because of one term: all that it moves, those of one function, ...

        ... or those that lack the same of it, where something else is wrong as well.
        """
        used = {
            name: mask
            for name, x in slope.items()
            if (mask := (np.abs(x) > 0.0).any(axis=0) & self._wrong[name]).any()
        }
        if not used:
            return []
        groups: list[Wrong] = [used, *({n: mask} for n, mask in used.items() if len(used) > 1)]
        count = sum(map(np.count_nonzero, used.values()))
        alike = _lacking_alike(used, slope, rest, constant)
        for members in sorted(alike, key=len, reverse=True)[:2]:
            if len(members) < count and (len(members) > 1 or constant):
                masks = {name: np.zeros_like(used[name]) for name, _ in members}
                for name, column in members:
                    masks[name][column] = True
                groups.append(masks)
        return groups

    def _slope(
        self, pick: Pick, names: Iterable[str], rows: int
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return how much a term moves what functions give, and what that lacks; nothing if they fail."""
        assert pick.values is not None
        here = self.editor.outputs_with(names, rows, pick)
        nudged = pick._replace(values={ALL: pick.values[ALL] + _NUDGE})
        there = self.editor.outputs_with(names, rows, nudged)
        if here is None or there is None:
            return {}, {}
        slope = {name: (there[name] - here[name]) / _NUDGE for name in here}
        return slope, {name: self._targets[name].values[:rows] - here[name] for name in here}

    def _root(self, pick: Pick, used: Wrong, constant: bool) -> Array | None:
        """Return the term for which some values agree, by Gauss and Newton; None without one."""
        values, near, before = np.zeros(ROWS), 0, np.inf
        for step in range(_STEPS if constant else _STEPS // 2):
            # One number shows at two states whether it is right.
            rows = _FEW if constant or step == 0 else ROWS
            slopes, rests = self._slope(pick._replace(values={ALL: values}), list(used), rows)
            if not slopes:
                return None
            slope, rest = (
                np.concatenate([x[n][:, u] / self._targets[n].tolerance[u] for n, u in used.items()], axis=1)
                for x in (slopes, rests)
            )
            near += bool(step) and bool(np.abs(rest).max() <= 1.0)
            if near == _REFINED:
                return values
            left = float(np.linalg.norm(rest))
            if not near and left > _SLOW * before:
                return None
            before = left if step else np.inf
            if constant:
                slope, rest = slope.reshape(1, -1), rest.reshape(1, -1)
            size = np.einsum("ij,ij->i", slope, slope)
            if not (size > 0.0).all():
                return None
            move = np.einsum("ij,ij->i", slope, rest) / size
            # One number can hardly explain what several values lack.
            apart = np.linalg.norm(rest - move[:, np.newaxis] * slope, axis=1)
            if step == 0 and not constant and (apart > 0.5 * np.linalg.norm(rest, axis=1)).any():
                return None
            values = values.copy()
            values[: None if constant else rows] += move
        return None

    # Two changes at once.

    def _candidates(self) -> tuple[str, list[tuple[_Tried, int]], Array, Array]:
        """Return a function that differs, what was tried on it with the effects, and what it lacks."""
        differing = self._differing(self._targets)
        count = {n: sum(len(one.effects.get(n, ())) for one in self._tried) for n in differing}
        name = max(count, key=lambda n: count[n], default="")
        if not count.get(name):
            return name, [], np.zeros((0, 0)), np.zeros(0)
        unit = 1e3 * self._targets[name].tolerance
        last = _rows_of([name]) - 1
        lacking = (self._targets[name].values[last] - self._start[name][last]) / unit
        groups = [one for one in self._tried if name in one.effects]
        tried = [(one, k) for one in groups for k in range(len(one.effects[name]))]
        effects = np.concatenate([one.effects[name] for one in groups]) / unit
        size = np.abs(effects).max(axis=1)
        good = (size > 0.0) & (size < _HUGE / unit.min())
        return name, [one for one, g in zip(tried, good, strict=True) if g], effects[good], lacking

    def pairs(self) -> Iterator[tuple[Pick, Pick]]:
        """Yield the pairs of changes whose effects add up to what differs, the short ones first."""
        _, tried, effects, lacking = self._candidates()
        if len(tried) < 2:
            return
        from scipy.spatial import cKDTree  # half of the time of importing this package, and rarely needed

        near = 1e-2 * np.sqrt(len(lacking))
        _, places = cKDTree(effects).query(lacking - effects, k=20, distance_upper_bound=near)
        first, column = np.nonzero((places > np.arange(len(tried))[:, np.newaxis]) & (places < len(tried)))
        pairs = [*zip(first.tolist(), places[first, column].tolist(), strict=True)]
        picks = {i: tried[i][0].at(tried[i][1]) for i in {*itertools.chain.from_iterable(pairs)}}
        for i, j in sorted(pairs, key=lambda pair: (picks[pair[0]].bits + picks[pair[1]].bits, pair))[:50]:
            if self._both(picks[i], picks[j]):
                yield picks[i], picks[j]

    def tried_pairs(self) -> Iterator[tuple[Pick, Pick]]:
        """Try pairs of usual changes, and yield those that make all agree.

        Each change of a pair alone moves no output that is right already: changes that cancel there are not
        looked for.
        """
        name, tried, effects, _ = self._candidates()
        if len(tried) < 2:
            return
        right = ~self._wrong[name]
        inside = np.abs(effects[:, right]).max(axis=1, initial=0.0) <= _NO_EFFECT
        picks = [one.at(k) for (one, k), i in zip(tried, inside, strict=True) if i and one.kind in _USUAL]
        # Candidates are in the order in which they were tried, pairs in that of the later one of both.
        for later, two in enumerate(picks):
            for one in picks[:later]:
                if self.is_over():
                    return
                outputs = self.editor.outputs_with([name], _rows_of([name]), one, two)
                if (
                    outputs is not None
                    and not self._goal.away(name, outputs[name]).any()
                    and self._both(one, two)
                ):
                    yield one, two

    def _both(self, one: Pick, two: Pick) -> bool:
        """Tell whether two changes make all agree."""
        if one.block is two.block and one.site == two.site:
            return False
        outputs = self.editor.outputs_with(self._targets, ROWS, one, two)
        return outputs is not None and not self._matters(self._off(outputs))


def _is_usual(pick: Pick) -> bool:
    return pick.kind in _USUAL or pick.sure


def _rows_of(names: Sequence[str]) -> int:
    """Return at how many states functions are looked at first: a potential is counted from the first one."""
    return _FEW if "potential_energy" in names else 1


def _has_joints(node: ast.expr) -> bool:
    """Tell whether an expression is the positions of the joints, one of them, or an array."""
    if isinstance(node, ast.Call):
        return function_name(node) == "array"
    of = node.value if isinstance(node, ast.Subscript) else node
    return isinstance(of, ast.Name) and (of.id in POSITIONS or joint_of(f"{of.id}_1") is not None)


def _lacking_alike(
    used: Wrong, slope: Mapping[str, Array], rest: Mapping[str, Array], constant: bool
) -> Iterable[list[tuple[str, int]]]:
    """Return the values of functions that lack the same of a term; a constant's at all states."""
    alike: dict[tuple[float, ...], list[tuple[str, int]]] = {}
    for name, mask in used.items():
        for k in np.flatnonzero(mask).tolist():
            with np.errstate(all="ignore"):
                moves = rest[name][:, k] / slope[name][:, k]
            same = not constant or bool(abs(np.ptp(moves)) <= 1e-6 * abs(moves[0]))
            if np.isfinite(moves).all() and same:
                alike.setdefault(tuple(float(f"{x:.5g}") for x in moves), []).append((name, k))
    return alike.values()


def _fitting_vectors(
    block: Block, seen: Sequence[dict[str, Any]], shape: tuple[int, ...], most: int | None
) -> tuple[list[tuple[int, str, CodeType]], Array]:
    """Return the first terms of vectors that have values of a shape: place, text and code; and the values."""
    found, values = [], []
    for place, (text, code) in enumerate([*block.terms_of_vectors.items()][:most]):
        x = _at_every(code, block.namespace, seen)
        if x.shape == shape:
            found.append((place, text, code))
            values.append(x.ravel())
    return found, np.array(values).reshape(len(found), math.prod(shape))


def _linear(effects: Sequence[Array]) -> tuple[bool, Array, float]:
    """Return whether a function is linear in a term, its slope, and how much is nothing.

    Args:
        effects: what it gives without the term, with every unit step of it, and with all of them.
    """
    start, *axes, together = effects
    slope = np.stack(axes) - start
    rest = 1e-6 * float(1.0 + np.abs(together).max())
    return bool(np.abs(together - start - slope.sum(axis=0)).max() <= rest), slope, rest


def _keep(seen: list[dict[str, Any]], names: dict[str, Any]) -> float:
    """Keep local variables; what they give is nothing."""
    seen.append(dict(names))
    return 0.0


def _next(steps: Iterator[Array], _: dict[str, Any]) -> Array:
    return next(steps)


def _at_every(code: CodeType, namespace: dict[str, Any], seen: Sequence[dict[str, Any]]) -> Array:
    """Return an expression's values at every pass of a loop, no numbers where it has none or is nothing."""
    try:
        values = np.array([eval(code, namespace, names) for names in seen], dtype=np.float64)
    except Exception:  # a name that is not there yet
        return np.zeros(0)
    return values if values.any() else np.zeros(0)


def _missing_terms(block: Block, site: Site, values: Array) -> Iterator[tuple[str, float]]:
    """Yield what an expression has to be where a term of known values is missing in it."""
    if isinstance(site.node, ast.Constant):
        if np.ptp(values) <= 1e-9 * np.abs(values).max():
            yield from _number(site.node, bool(site.literal), float(values[0]))
        if site.literal or site.node.value != 0:
            return
    old = ast.unparse(site.node)
    dictionary = block.dictionary(site.node.lineno)
    terms = [(_sum(old, found.text), found.bits) for found in dictionary.terms(values)]
    yield from terms or _missing_factors(block, site, values, dictionary)


def _missing_factors(
    block: Block, site: Site, values: Array, dictionary: Dictionary
) -> Iterator[tuple[str, float]]:
    """Yield what an expression has to be where a factor is missing in all of it, or in one of its parts."""
    for part, sign in _parts(site.node):
        now = block.values(ast.unparse(part))
        if now is None or now.shape != values.shape:
            continue
        with np.errstate(all="ignore"):
            factor = 1.0 + sign * values / now
        several = dictionary.terms(factor)
        for found in several:
            new: ast.expr = ast.BinOp(ast.parse(found.text, mode="eval").body, ast.Mult(), part)
            yield ast.unparse(with_part(site.node, part, new)), found.bits + 1.0
        for found in () if several else dictionary.terms(now + sign * values):
            new = ast.parse(found.text, mode="eval").body
            yield ast.unparse(with_part(site.node, part, new)), found.bits + 2.0


def _parts(node: ast.expr, sign: float = 1.0) -> Iterator[tuple[ast.expr, float]]:
    """Yield the terms of a sum with their signs."""
    yield node, sign
    if is_sum(node):
        yield from _parts(node.left, sign)
        yield from _parts(node.right, sign if isinstance(node.op, ast.Add) else -sign)


def _sum(old: str, term: str) -> str:
    """Return a sum as text."""
    if old in ("0", "0.0"):
        return term
    return f"{old} - {term.removeprefix('-')}" if term.startswith("-") else f"{old} + {term}"


def _number(node: ast.Constant, named: bool, change: float) -> Iterator[tuple[str, float]]:
    """Yield another number in place of one: one in another unit, one of few digits."""
    old = float(ast.literal_eval(node))
    new = 0.0 if abs(old + change) <= 1e-9 * abs(old) else old + change
    text = next(t for digits in range(1, 18) if abs(float(t := f"{new:.{digits}g}") - new) <= 1e-7 * abs(new))
    if (new * old <= 0.0 and named) or old in GRAVITY:
        return  # nothing has the other sign by chance, and gravity is what it is
    # A coefficient that was printed has more digits than one of a formula.
    digits = 5 if old not in USUAL and isinstance(node.value, float) else 2
    count = len(text.lstrip("-0.").replace(".", ""))
    if named or count <= digits:
        yield text, _DIGIT_BITS * count
