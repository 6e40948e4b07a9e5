"""A process of its own for the user's model, so that nothing it does can harm or hang ours.

A model may raise, hang, print, call ``sys.exit``, change its arguments or end the process. It runs in a
forked child, which takes lists of calls and sends the answers back as JSON: a pickle would be code of the
model in the parent. The parent waits for each call no longer than a limit, and takes nothing that it reads
for granted. What went wrong becomes a :class:`armgpi.errors.ModelError`. All that the model has started
ends with it (:mod:`armgpi.validation.containment`).
"""

from __future__ import annotations

import ast
import gc
import io
import json
import multiprocessing
import os
import pickle
import resource
import signal
import socket
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ModelError, ParameterError, Remedy
from armgpi.validation import containment, edits, mechanics, models, proofs, search, units
from armgpi.validation.conventions import Convention
from armgpi.validation.forms import Adapted, Form
from armgpi.validation.line import Counter, Line, pair

#: Reading a model may take so many times as long as one call, and always so long [s]: it may have to import
#: or derive something first.
LOADING, LOADING_LEAST = 12.0, 10.0
#: Memory that a model may take [bytes]; beyond it raises MemoryError.
MEMORY = 4 * 1024**3
#: Answers of calls are sent together, as often as this [s].
_TOGETHER = 0.05
#: Exit codes of the process when its pipe is gone, when the Python in it no longer works, and when it cannot
#: be isolated: large ones, which few programs use.
_CUT, _BROKEN, _OPEN = 96, 97, 98
#: What the process is asked for besides calls of functions, which have names without blanks.
_SEARCH, _REREAD = "search the source", "read another source"
#: No function of a model returns more numbers than this: D of 64 joints has 4096.
_MOST_NUMBERS, _JOINTS, _DIMENSIONS = 10_000, 64, 8
#: Longest answer that is taken [bytes], and most values and separators in it: a short text of empty lists
#: would take a hundred times its size.
_LONGEST, _MOST_VALUES = 64 * 2**20, 2_000_000
#: Answers are sent when they have so many numbers, however little time has passed.
_MANY_NUMBERS = 200_000
#: How long an answer may take from its first byte to its last, and the keeper to end all processes [s].
_ARRIVES, _ENDS = 30.0, 10.0
#: How long the answer of a search may take beyond ten times what it may compute [s].
_SEARCHED = 60.0
#: Longest text of the model that is shown.
_SHOWN = 500


class Worker:
    """The model in its own process; a context manager, which ends it.

    Attributes:
        name: what the model is called in messages.
        functions: names of the functions that it has.
        n: number of joints that it states, None when it does not.
        source: the text of its file, None when it has none that can be read.
        time_limit: how long one call may take [s].
        convention: how the model may differ from the robot.
        printed: whether it has printed something.
        uncompared: its other functions of a state, which nothing compares.
        forms: of its functions those that take or return arrays in another form, once they were called.
        takes: how long a call takes [s], per function: the least so far.
        uses: time of the processor that a call takes [s], per function: the least so far.
        means: what isolates it, "" when nothing does.
        read_seconds: time of the processor that reading it has taken [s].
        seconds: time of the processor that it has taken, with the calls of which it has answered [s].
        seconds_of_ended: time of the processor that all processes of models took that have ended [s].
    """

    seconds_of_ended = 0.0

    def __init__(
        self,
        model: Any,
        name: str,
        time_limit: float,
        source: str | None = None,
        convention: Convention | None = None,
        isolate: bool = False,
    ) -> None:
        """Start the process and read the model in it, from another text than its file's when one is given.

        Raises:
            ModelError: when the model cannot be read.
            ParameterError: when this system cannot isolate it, and that was asked for.
        """
        self.name = name
        self.time_limit, self.convention, self.isolate = time_limit, convention, isolate
        self._model = model
        self.means = _means_of_isolation(model) if isolate else ""
        self.takes: dict[str, float] = {}
        self.uses: dict[str, float] = {}
        self.forms: dict[str, Form] = {}
        # Forked, as a model may be an object that cannot be pickled (closures, a class in a notebook), and as
        # a fresh Python would take a second to import what is imported here already.
        context = multiprocessing.get_context("fork")
        # Which of its calls the process is at, also when it never comes back.
        self._started = Counter()
        self._line, theirs = pair()
        given = (model, source, convention)
        kept = (self._line, theirs, self.means, given, self._started)
        self._process = context.Process(target=_keep, args=kept, daemon=True)
        # What is in a buffer at the fork would be written by both.
        sys.stdout.flush()
        sys.stderr.flush()
        with warnings.catch_warnings():
            # Newer Pythons warn of forks beside threads; the child uses none of ours.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        theirs.close()  # so that the line ends with the child
        try:
            self._take_opening()
        except BaseException:
            self.close()
            raise

    def _take_opening(self) -> None:
        """Take what the process says of the model that it has read."""
        answer = self._receive("", max(LOADING * self.time_limit, LOADING_LEAST), "to read")
        try:
            opening = _read_opening(answer)
        except _ODD:
            raise self._nonsense("") from None
        self.functions, self.n, self.printed = opening.functions, opening.n, opening.printed
        self.source, self.uncompared = opening.source, opening.uncompared
        self.seconds = self.read_seconds = opening.seconds

    def reread(self, source: str) -> None:
        """Read the model again in this process, from another text than its file's.

        A process of its own for each text would be cleaner, but a fork of a large program takes a tenth of
        a second. This is for texts that are tried by the dozen and leave nothing behind
        (:func:`armgpi.validation.edits.harmless`).

        Raises:
            ModelError: when it cannot be read; the process is of no use afterwards.
        """
        self.takes, self.uses, self.forms = {}, {}, {}
        try:
            self._line.send(pickle.dumps((_REREAD, source)), _ARRIVES)
        except OSError:
            raise self._died("") from None
        self._take_opening()

    def again(self, source: str | None = None) -> Worker:
        """Return another process of the same model, from another text than its file's when one is given.

        Raises:
            ModelError: when the model cannot be read.
        """
        return Worker(self._model, self.name, self.time_limit, source, self.convention, self.isolate)

    def __enter__(self) -> Worker:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process."""
        self.close()

    def close(self) -> None:
        """End the process, whatever it is doing, and those that it has started."""
        if self._process.pid is not None and not self._has_ended_within(0.0):
            with suppress(OSError):
                os.kill(self._process.pid, signal.SIGCONT)  # a model may have stopped its keeper
            self._process.terminate()
            if not self._has_ended_within(_ENDS):
                self._process.kill()
        self._has_ended_within(None)
        self._line.close()
        self._started.close()

    def _has_ended_within(self, seconds: float | None) -> bool:
        """Wait for the end of the process, and count what it took; None waits for as long as it takes."""
        before = _seconds_of_children()
        self._process.join(seconds)
        has_ended = not self._process.is_alive()
        Worker.seconds_of_ended += _seconds_of_children() - before
        return has_ended

    def call(self, function: str, states: Sequence[Sequence[Array]]) -> list[Array]:
        """Return what a function of the model gives at some states, as float arrays of any shape.

        Args:
            function: its name.
            states: for every call its arguments.

        Raises:
            ModelError: when a call raises, gives something that is no numbers, takes too long, changes its
                arguments, or ends the process.
        """
        self._started.value = 0
        try:
            self._line.send(pickle.dumps((function, states)), max(self.time_limit, _ARRIVES))
        except OSError:
            raise self._died(function) from None
        values: list[Array] = []
        while len(values) < len(states):
            answer = self._receive(function, self.time_limit + _TOGETHER, "", states)
            try:
                taken = [_read_call(each) for each in answer]
            except _ODD:
                raise self._nonsense(function) from None
            if not 0 < len(taken) <= len(states) - len(values):
                raise self._nonsense(function)
            for value, printed, took, form, used in taken:
                self.seconds += used
                if any(form):
                    self.forms[function] = form
                # The least: the machine may be busy, a function is never faster than it is.
                self.takes[function] = min(self.takes.get(function, took), took)
                self.uses[function] = min(self.uses.get(function, used), used)
                self.printed = self.printed or printed
                values.append(value)
        return values

    def search(self, goal: edits.Goal, known: Sequence[float], budget: float) -> proofs.Searched:
        """Look for changes of the source with which the model gives what it should.

        The model is of no use afterwards. What it raises, or that it ends its process by ``exit``, is no
        failure: such a source is too odd to be changed. A process that ends in another way, or does not
        answer, is one, and is said.

        Args:
            goal: what its functions should give.
            known: numbers that are right, which stay.
            budget: time of the processor [s]. With 0 nothing is changed: it is only found what the model's
                numbers are in the robot.
        """
        try:
            self._line.send(pickle.dumps((_SEARCH, (goal, known, budget))), _ARRIVES)
            answer = self._receive("", _SEARCHED + 10.0 * budget, "to search its source")
        except (OSError, ModelError) as error:
            return proofs.Searched(None, failure=self._failure_of_search(error))
        try:
            found, unsearched, failure = answer
            repaired = _read_repaired(found, self.source)
            return proofs.Searched(repaired, tuple(map(_line_of, unsearched)), _line_of(failure))
        except _ODD as error:
            return proofs.Searched(None, failure=f"its answer is {type(error).__name__}: {error}")

    def _failure_of_search(self, error: Exception) -> str:
        """Return why the process of a search gave no answer, "" where the model itself has ended it."""
        self._has_ended_within(_ENDS)
        code = self._process.exitcode
        if code is not None and 0 < code < _CUT:
            return ""  # an exit code of the model's own: ours are larger, and 0 is that of a process we end
        return " ".join(str(error).removeprefix(f"{self.name}: ").split())[:_SHOWN]

    def _receive(
        self, function: str, limit: float, doing: str, states: Sequence[Sequence[Array]] = ()
    ) -> Any:
        """Return the next answer, or raise what it says of the state that was called last."""
        try:
            text = self._line.receive(_LONGEST, limit, _ARRIVES)
            if sum(map(text.count, (b"[", b"{", b","))) > _MOST_VALUES:
                raise ValueError
            good, answer = json.loads(text)
            if not isinstance(good, bool) or not (good or isinstance(answer, str)):
                raise ValueError
        except TimeoutError:
            self.close()  # from outside: a model may swallow every exception and mask every signal
            doing = self._last(function, states) if function else doing
            seconds = self.time_limit if function else limit
            text_of_it = f"took longer than {seconds:g} s {doing}; allow more time"
            raise ModelError(self.name, function, text_of_it).suggesting(Remedy("time_limit")) from None
        except (EOFError, OSError):
            raise self._died(function) from None
        except _ODD:
            raise self._nonsense(function) from None
        if not good:
            said = _line_of(answer)
            raise ModelError(
                self.name, function, f"{said} {self._last(function, states)}" if function else said
            )
        return answer

    def _last(self, function: str, states: Sequence[Sequence[Array]]) -> str:
        """Return "at q = ..., v = ..." for the call that was begun last."""
        # The model can write there as well.
        given = states[min(max(self._started.value, 1), len(states)) - 1]
        named = zip(models.ARGUMENTS[function], given, strict=True)
        return "at " + ", ".join(f"{name} = ({', '.join(f'{x:.4g}' for x in x_)})" for name, x_ in named)

    def _nonsense(self, function: str) -> ModelError:
        """End a process that wrote into the pipe to its parent, and return the error."""
        self.close()
        return ModelError(self.name, function, "writes into the pipe by which its process answers")

    def _died(self, function: str) -> ModelError:
        """Return the error of a process that is no more."""
        self._has_ended_within(_ENDS)  # the line ends a moment before the process
        code = self._process.exitcode
        if code == _CUT:
            return ModelError(self.name, function, "closes file descriptors that are not its own")
        if code == _OPEN:
            raise ParameterError("isolate", True, f"False, as {self.means} failed here") from None
        if code == containment.FULL:
            text = f"takes more than {MEMORY / 2**30:g} GiB of memory"
            return ModelError(self.name, function, text)
        if code == _BROKEN:
            text = "breaks the Python it runs in: does it replace builtins, or functions of NumPy?"
            return ModelError(self.name, function, text)
        if self.means and code is not None and code > containment.SIGNALLED:
            code = containment.SIGNALLED - code
        how = f"with exit code {code}"
        if code is not None and -code in set(signal.Signals):
            how = f"by {signal.Signals(-code).name}"
        return ModelError(self.name, function, f"ended its Python process {how}")


def _seconds_of_children() -> float:
    """Return the time of the processor that the processes took which this one has waited for [s]."""
    times = os.times()
    return times.children_user + times.children_system


#: What reading an answer that no process of ours has written may raise.
_ODD = (ArithmeticError, LookupError, MemoryError, RecursionError, SyntaxError, TypeError, ValueError)


class _Opening(NamedTuple):
    """What a process says of the model that it has read; see :class:`Worker`."""

    functions: list[str]
    n: int | None
    printed: bool
    source: str | None
    uncompared: tuple[str, ...]
    seconds: float


def _read_opening(answer: Any) -> _Opening:
    """Return what a process says of the model that it has read, checked."""
    functions, n, printed, source, uncompared, seconds = answer
    _check_type(seconds, float)
    _check_type(functions, list)
    _check_type(uncompared, list)
    _check_type(source, str | None)
    _check_type(n, int | None)
    if not functions or set(functions) - set(models.ARGUMENTS) or (n is not None and not 1 <= n <= _JOINTS):
        raise ValueError
    others = tuple(map(_line_of, uncompared))
    return _Opening(functions, n, bool(printed), _parsed(source), others, seconds)


def _check_type(value: Any, kind: Any) -> None:
    """Refuse a value of another type."""
    if not isinstance(value, kind) or isinstance(value, bool):
        raise TypeError


def _parsed(source: str | None) -> str | None:
    """Return a source, None when it is no Python: then no line of it can be named."""
    try:
        ast.parse(source or "")
    except (MemoryError, RecursionError, SyntaxError, ValueError):
        return None
    return source


def _line_of(value: Any) -> str:
    """Return a text in one line that is not too long."""
    return " ".join(_text(value).split())[:_SHOWN]


def _text(value: Any) -> str:
    """Return a text, refusing what is none."""
    _check_type(value, str)
    return str(value)


def _whole(value: Any, most: int) -> int:
    """Return a whole number from 0 to some, refusing what is none."""
    _check_type(value, int)
    if not 0 <= value <= most:
        raise ValueError
    return int(value)


class _Called(NamedTuple):
    """What a call gave.

    Attributes:
        values: its numbers.
        printed: whether the model has printed.
        took: how long it took [s].
        form: in which form its arrays are.
        used: time of the processor that it took [s].
    """

    values: Array
    printed: bool
    took: float
    form: Form
    used: float


def _read_call(answer: Any) -> _Called:
    """Return what a call gave, checked."""
    shape, numbers, printed, took, form, used = answer
    _check_type(shape, list)
    _check_type(numbers, list)
    _check_type(took, int | float)
    _check_type(used, int | float)
    if len(numbers) > _MOST_NUMBERS or len(shape) > _DIMENSIONS or not (took >= 0.0 and used >= 0.0):
        raise ValueError
    sizes = [_whole(size, _MOST_NUMBERS) for size in shape]
    values = np.array(numbers, dtype=np.float64).reshape(sizes)
    each_form = Form(*(bool(each) for each in form))
    return _Called(values, bool(printed), float(took), each_form, float(used))


def _read_repaired(answer: Any, own_source: str | None) -> proofs.Repaired | None:
    """Return changes of a source that were sent as JSON, if they are changes of that source."""
    if answer is None or own_source is None:
        return None
    changes, source, doubts, checked, other, sure, standing, spelled, odd = answer
    lines = own_source.splitlines()
    made = tuple(_read_change(change, len(lines)) for change in changes)
    ast.parse(_text(source))
    count = len(list(units.numbers(ast.parse(_text(spelled) or source))))
    rates: dict[int, dict[int, float]] = {}
    for k, each in standing:
        rates[_whole(k, count - 1)] = {_whole(j, _MOST_NUMBERS): float(rate) for j, rate in each}
    return proofs.Repaired(
        made,
        source,
        doubts=_whole(doubts, _MOST_NUMBERS),
        checked=_whole(checked, _MOST_NUMBERS),
        other=_whole(other, _MOST_NUMBERS),
        sure=bool(sure),
        standing=rates,
        spelled=spelled,
        odd=tuple(map(_line_of, odd)),
    )


def _read_change(change: Any, lines: int) -> edits.Change:
    """Return one change of a source of so many lines."""
    kind, (first, start, last, end), old, new, where, name, bits, reaches = change
    if not 1 <= _whole(first, lines) <= _whole(last, lines):
        raise ValueError
    span = (first, _whole(start, _LONGEST), last, _whole(end, _LONGEST))
    if kind in ("unit", "value"):
        float(old), float(new)
    return edits.Change(
        _text(kind),
        span,
        _text(old),
        _text(new),
        _text(where),
        _text(name),
        float(bits),
        frozenset(map(_text, reaches)),
    )


def _plain_repaired(found: proofs.Repaired | None) -> Any:
    """Return changes of a source as JSON has them; see :func:`_read_repaired`."""
    if found is None:
        return None
    changes = [[*change[:-1], sorted(change.reaches)] for change in found.changes]
    standing = [[int(k), [[int(j), float(x)] for j, x in each.items()]] for k, each in found.standing.items()]
    numbers = [int(found.doubts), int(found.checked), int(found.other), bool(found.sure)]
    return [changes, found.source, *numbers, standing, found.spelled, list(found.odd)]


def _send(line: Line, good: bool, answer: Any) -> None:
    """Send an answer as JSON."""
    line.send(json.dumps([good, answer], default=_plain_number).encode())


def _plain_number(value: Any) -> Any:
    """Return a number of NumPy as one of Python."""
    return value.item()


class _Silent(io.TextIOBase):
    """Takes what a model prints and remembers that it did."""

    used = False

    def write(self, text: str) -> int:
        self.used = True
        return len(text)


def _means_of_isolation(model: Any) -> str:
    """Return what isolates a model on this system; see :func:`containment.find_means`.

    Raises:
        ParameterError: when nothing does, or what does cannot run this model.
    """
    try:
        means = containment.find_means()
    except containment.Unavailable as error:
        raise ParameterError("isolate", True, f"False, as this system cannot: {error}") from None
    if means == containment.BUBBLEWRAP and not isinstance(model, str | Path):
        expected = "False, as only bubblewrap works here, which runs models of files: give its path or module"
        raise ParameterError("isolate", True, expected)
    return means


def _keep(parents: Line, line: Line, means: str, given: Sequence[Any], started: Counter) -> None:
    """Keep the process of a model: this one adopts what it starts, and ends with it."""
    parents.close()  # or the child would never see that the parent is gone
    with suppress(OSError):
        os.setsid()  # what a terminal sends to its group is not for us

    def serve() -> None:
        if means:
            containment.close_others([line.descriptor, started.descriptor])
        model, source, convention = given
        _serve(line, model, source, convention, started)

    def serve_closed_off() -> None:
        try:
            containment.close_off()
        except containment.Unavailable:
            os._exit(_OPEN)
        containment.keep(serve, MEMORY)  # the first process of a namespace: all others end with it

    def serve_in_bubblewrap() -> None:
        with suppress(OSError, containment.Unavailable):
            _start_in_bubblewrap(line, given, started)
        os._exit(_OPEN)

    if means == containment.NAMESPACES:
        try:
            containment.isolate()
        except containment.Unavailable:
            os._exit(_OPEN)
    runs = {"": serve, containment.NAMESPACES: serve_closed_off, containment.BUBBLEWRAP: serve_in_bubblewrap}
    containment.keep(runs[means], MEMORY)


def _start_in_bubblewrap(line: Line, given: Sequence[Any], started: Counter) -> None:
    """Become bubblewrap with a fresh Python, which reads from a file what a forked one has."""
    with tempfile.TemporaryFile() as file:
        pickle.dump(given, file)
        file.flush()
        kept = [line.descriptor, started.descriptor, file.fileno()]
        containment.close_others(kept)
        for descriptor in kept:
            os.set_inheritable(descriptor, True)
        numbers = ", ".join(map(str, kept))
        found_as_here = f"import sys; sys.path[:] = {sys.path!r}"
        program = f"{found_as_here}; from {__name__} import serve_fresh; serve_fresh({numbers})"
        command = [*containment.bubblewrap(), sys.executable, "-c", program]
        os.execv(command[0], command)


def serve_fresh(line: int, started: int, given: int) -> None:
    """Answer for a model in a fresh Python, given the file descriptors of line, counter and model."""
    with open(given, "rb") as file:
        file.seek(0)
        model, source, convention = pickle.load(file)  # from armgpi itself
    _serve(Line(socket.socket(fileno=line)), model, source, convention, Counter(started))


def _serve(
    line: Line, model: Any, source: str | None, convention: Convention | None, started: Counter
) -> None:
    """Answer for the model in the child: read it, then answer calls until the parent goes away."""
    try:
        own, silent = os.getpid(), _prepare(model)
        functions = _read_model(line, model, source, convention, silent, own)
        while True:
            try:
                name, given = pickle.loads(line.receive(_LONGEST))  # from armgpi itself
            except EOFError:
                os._exit(0)
            if name == _REREAD:
                functions = _read_model(line, model, given, convention, silent, own)
            elif name == _SEARCH:
                found = _search(functions, lambda s: models.resolve(model, s, convention), *given)
                _send(line, True, [_plain_repaired(found.found), list(found.unsearched), found.failure])
                os._exit(0)
            else:
                _answer_calls(line, functions, name, given, silent, own, started)
    except OSError:  # the line is gone
        os._exit(_CUT)
    finally:
        os._exit(_BROKEN)  # not sys.exit: no handler of the parent's may run twice


def _read_model(
    line: Line, model: Any, source: str | None, convention: Convention | None, silent: _Silent, own: int
) -> models.Functions:
    """Read the model and say what it has, or why it cannot be read, and end.

    `own` is the process that may: a copy that the model makes of itself may not.
    """
    try:
        functions = models.resolve(model, source, convention)
        _end_copies(own)
        text = functions.origin.source if functions.origin is not None else None
        uncompared = list(functions.uncompared)
        seconds = time.process_time()
        _send(line, True, [list(functions.calls), functions.n, silent.used, text, uncompared, seconds])
    except BaseException as error:
        _end_copies(own)
        _send(line, False, _description(error))
        os._exit(0)
    return functions


def _prepare(model: Any) -> _Silent:
    """Take from the process its parent's group, signals, streams and arguments, and limit its memory."""
    # What the program had made before the fork stays. To look for garbage in it would copy all of its pages,
    # which takes longer than a search in a program of some million objects.
    gc.freeze()
    with suppress(OSError):
        os.setsid()  # a group of its own: what the model starts ends with it
    for number in signal.valid_signals():
        # A handler of the program that we run in (a test runner's alarm, say) must not run for the model.
        if callable(signal.getsignal(number)):
            signal.signal(number, signal.SIG_DFL)
    with suppress(OSError, ValueError):  # where there is no /proc, the report says that nothing bounds it
        # What we have mapped already, and as much again as a model may need.
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    silent = _Silent()
    for stream in ("stdout", "stderr", "__stdout__", "__stderr__"):
        setattr(sys, stream, silent)
    with suppress(OSError):
        null = os.open(os.devnull, os.O_RDWR)
        for descriptor in (0, 1, 2):
            os.dup2(null, descriptor)
        sys.stdin = open(os.devnull)  # noqa: SIM115 (input() then raises instead of waiting)
    warnings.simplefilter("ignore")  # those of the model are its own business
    sys.argv = [str(model)]  # a script that reads its arguments must not get ours
    return silent


def _search(
    functions: models.Functions, again: proofs.Again, goal: edits.Goal, known: Sequence[float], budget: float
) -> proofs.Searched:
    """Look for changes of a source with which the model gives what it should.

    What the model raises ends the search without a word: its source is too odd to be changed. Any other
    exception is a defect of ours, and is said.
    """
    origin = functions.origin
    try:
        if origin is None or not edits.harmless(origin.source):
            return proofs.Searched(None)
        np.cross = edits.cross  # this process ends with the search
        functions = _as_graph(functions, again, goal)
        if budget == 0.0:
            return proofs.Searched(search.vary_numbers(functions, again, goal))
        return search.find_repair(functions, again, goal, known, budget)
    except (models.Unusable, SystemExit):
        return proofs.Searched(None)
    except BaseException as error:  # a defect of ours may be one that no `except Exception` catches
        path = "" if origin is None else origin.path
        if _is_of_model(error, path):
            return proofs.Searched(None)
        return proofs.Searched(None, failure=_described_as_ours(error))


def _is_of_model(error: BaseException, path: str) -> bool:
    """Tell whether an exception was raised while code of the model ran.

    Args:
        error: the exception.
        path: name of the model's file.
    """
    names = [frame.filename for frame in traceback.extract_tb(error.__traceback__)]
    # What SymPy writes has no file.
    return any(name == path or name.startswith("<lambdifygenerated") for name in names)


def _described_as_ours(error: BaseException) -> str:
    """Return what an exception of ours was and where, in one line."""
    ours = Path(__file__).parent
    frames = traceback.extract_tb(error.__traceback__)
    place = next((frame for frame in reversed(frames) if ours in Path(frame.filename).parents), frames[-1])
    said = " ".join(str(error).split())
    return f"{type(error).__name__}: {said} ({Path(place.filename).name}, line {place.lineno})"[:_SHOWN]


def _as_graph(functions: models.Functions, again: proofs.Again, goal: edits.Goal) -> models.Functions:
    """Return a model read anew, drawn as a graph, which is changed fast, if that gives the same.

    Anew, as `from numpy import cross` has another one.
    """
    origin = functions.origin
    assert origin is not None
    if not {"sympy", "casadi"} & sys.modules.keys():
        return again(origin.source)
    names = [name for name, target in goal.targets.items() if target.whole]
    real = [goal.call(functions.calls, name, edits.ALL, 0) for name in names]
    uninstall = mechanics.install()
    try:
        other = again(origin.source)
        for name, one in zip(names, real, strict=True):
            if not np.allclose(one, goal.call(other.calls, name, edits.ALL, 0), rtol=1e-9, atol=1e-12):
                raise ValueError
        return other
    except Exception:  # it uses more of them
        uninstall()
        return again(origin.source)


def _answer_calls(
    line: Line,
    functions: models.Functions,
    name: str,
    states: Sequence[Sequence[Array]],
    silent: _Silent,
    own: int,
    started: Counter,
) -> None:
    """Answer one list of calls up to the first that fails; `own` is the process that may."""
    try:
        function = functions.calls[name]
        innermost = function if isinstance(function, Adapted) else getattr(function, "__wrapped__", None)
        answers, sent, count = [], time.perf_counter(), 0
        for state in states:
            started.value += 1
            given = [np.array(x) for x in state]  # copies, so that a change is seen
            start, began = time.perf_counter(), time.process_time()
            value = _numbers(function(*given))
            _end_copies(own)
            for label, x, before in zip(models.ARGUMENTS[name], given, state, strict=True):
                if not np.array_equal(x, before):
                    raise models.Unusable(f"changes its argument {label} in place; let it work on a copy")
            now = time.perf_counter()
            form = list(getattr(innermost, "form", None) or ())
            used = time.process_time() - began
            answers.append((value.shape, value.ravel().tolist(), silent.used, now - start, form, used))
            count += value.size
            if now - sent > _TOGETHER or count > _MANY_NUMBERS:
                _send(line, True, answers)
                answers, sent, count = [], now, 0
        if answers:
            _send(line, True, answers)
    except BaseException as error:
        _end_copies(own)
        _send(line, False, _description(error))


def _end_copies(own: int) -> None:
    """End a copy of the process that the model has made by forking: it would answer, and fork, as well."""
    if os.getpid() != own:
        os._exit(0)


def _numbers(value: Any) -> Array:
    """Return what a function gave as an array of float64.

    Raises:
        Unusable: when it is nothing that can be one.
    """
    if value is None:
        raise models.Unusable("returns nothing (None)")
    try:
        if hasattr(value, "tolist") and not isinstance(value, np.ndarray | np.generic):
            value = value.tolist()  # a SymPy matrix
        array = np.asarray(value)
        if array.dtype.kind == "O":
            array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise models.Unusable(f"returns no array of numbers ({type(value).__name__}: {error})") from None
    if array.dtype.kind not in "iuf":
        raise models.Unusable(f"returns no real numbers (dtype {array.dtype})")
    if array.size > _MOST_NUMBERS:
        raise models.Unusable(f"returns {array.size} numbers, shape {array.shape}")
    return np.array(array, dtype=np.float64)


def _description(error: BaseException) -> str:
    """Return what a model's error was and where in the model."""
    if isinstance(error, models.Unusable):
        return str(error)
    if isinstance(error, SystemExit):
        return f"calls sys.exit({error.code!r})"
    frames = traceback.extract_tb(error.__traceback__, limit=-30)  # the last: recursion has thousands
    ours = Path(__file__).parent
    theirs = [frame for frame in frames if ours not in Path(frame.filename).parents]
    place = ""
    if isinstance(error, SyntaxError) and error.lineno is not None:
        place = f" ({Path(error.filename or '').name}, line {error.lineno})"
        error = SyntaxError(error.msg)
    else:
        theirs = [frame for frame in theirs if "importlib" not in frame.filename]
        if theirs:
            place = f" ({Path(theirs[-1].filename).name}, line {theirs[-1].lineno})"
    try:
        text = " ".join(str(error).split())[:300]  # one line of the report
    except Exception:
        text = ""  # an error that cannot say what it is
    return f"raises {': '.join(filter(None, (type(error).__name__, text)))}{place}"
