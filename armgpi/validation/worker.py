"""A process of its own for the user's model, so that nothing it does can harm or hang ours.

A model may raise, hang, print, call ``sys.exit``, change its arguments or end the process. It runs in a
forked child, which takes lists of calls and sends the answers back as JSON: a pickle would be code of the
model in the parent. The parent waits for each call no longer than a limit. What went wrong becomes a
:class:`armgpi.errors.ModelError`.
"""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import ModelError, Remedy
from armgpi.validation import edits, graph, models, search
from armgpi.validation.conventions import Convention

#: Reading a model may take so many times as long as one call, and always so long [s]: it may have to import
#: or derive something first.
LOADING, LOADING_LEAST = 12.0, 10.0
#: Memory that a model may take [bytes]; beyond it raises MemoryError.
MEMORY = 4 * 1024**3
#: Answers of calls are sent together, as often as this [s].
_TOGETHER = 0.05
#: Exit codes of the process when its pipe is gone, and when the Python in it no longer works: large ones,
#: which few programs use.
_CUT, _BROKEN = 96, 97
#: No function of a model returns more numbers than this: D of 64 joints has 4096.
_MOST_NUMBERS = 10_000
#: Longest answer that is taken [bytes].
_LONGEST = 64 * 2**20


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
        takes: how long a call takes [s], per function: the least so far.
    """

    def __init__(
        self,
        model: Any,
        name: str,
        time_limit: float,
        source: str | None = None,
        convention: Convention | None = None,
    ) -> None:
        """Start the process and read the model in it, from another text than its file's when one is given.

        Raises:
            ModelError: when the model cannot be read.
        """
        self.name = name
        self.time_limit, self.convention = time_limit, convention
        self.takes: dict[str, float] = {}
        # Forked, as a model may be an object that cannot be pickled (closures, a class in a notebook), and as
        # a fresh Python would take a second to import what is imported here already.
        context = multiprocessing.get_context("fork")
        # In shared memory: which of its calls the process is at, also when it never comes back.
        self._started = context.RawValue("L", 0)
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(self._pipe, theirs, model, source, convention, self._started), daemon=True
        )
        # What is in a buffer at the fork would be written by both.
        sys.stdout.flush()
        sys.stderr.flush()
        with warnings.catch_warnings():
            # Newer Pythons warn of forks beside threads; the child uses none of ours.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        theirs.close()  # so that the pipe ends with the child
        try:
            answer = self._receive("", max(LOADING * time_limit, LOADING_LEAST), "reading it")
            try:
                self.functions, self.n, self.printed, self.source, self.uncompared = _read_opening(answer)
            except (TypeError, ValueError):
                raise self._nonsense("") from None
        except BaseException:
            self.close()
            raise

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
        # Its group has its id, and is there as long as the process has not been waited for.
        with suppress(OSError):
            if self._process.pid is not None and os.getpgid(self._process.pid) == self._process.pid:
                os.killpg(self._process.pid, signal.SIGKILL)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self._pipe.close()

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
            self._pipe.send((function, states))
        except OSError:
            raise self._died(function) from None
        values: list[Array] = []
        while len(values) < len(states):
            answer = self._receive(function, self.time_limit + _TOGETHER, "", states)
            try:
                taken = [_read_call(each) for each in answer]
            except (TypeError, ValueError):
                raise self._nonsense(function) from None
            if not 0 < len(taken) <= len(states) - len(values):
                raise self._nonsense(function)
            for value, printed, took in taken:
                # The least: the machine may be busy, a function is never faster than it is.
                self.takes[function] = min(self.takes.get(function, took), took)
                self.printed = self.printed or printed
                values.append(value)
        return values

    def search(self, goal: edits.Goal, known: Sequence[float], budget: float) -> search.Repaired | None:
        """Return changes of the source with which the model gives what it should, None without such.

        Numbers that are `known` to be right stay. The model is of no use afterwards. With a budget of 0
        nothing is changed: it is only found what the model's numbers are in the robot.
        """
        try:
            self._pipe.send(("", (goal, known, budget)))
            return _read_repaired(self._receive("", 10.0 * search.BUDGET, ""))
        except (OSError, ModelError, TypeError, ValueError):
            return None

    def _receive(
        self, function: str, limit: float, doing: str, states: Sequence[Sequence[Array]] = ()
    ) -> Any:
        """Return the next answer, or raise what it says of the state that was called last."""
        try:
            if not self._pipe.poll(limit):
                self.close()  # from outside: a model may swallow every exception and mask every signal
                doing = self._last(function, states) if function else "to read"
                text = (
                    f"took longer than {self.time_limit if function else limit:g} s {doing}; allow more time"
                )
                raise ModelError(self.name, function, text).suggesting(Remedy("time_limit"))
            good, answer = json.loads(self._pipe.recv_bytes(_LONGEST))
        except (EOFError, OSError):
            raise self._died(function) from None
        except (ValueError, TypeError, RecursionError):
            raise self._nonsense(function) from None
        if not good:
            text = f"{answer} {self._last(function, states)}" if function else answer
            raise ModelError(self.name, function, text)
        return answer

    def _last(self, function: str, states: Sequence[Sequence[Array]]) -> str:
        """Return "at q = ..., v = ..." for the call that was begun last."""
        given = states[max(self._started.value, 1) - 1]
        named = zip(models.ARGUMENTS[function], given, strict=True)
        return "at " + ", ".join(f"{name} = ({', '.join(f'{x:.4g}' for x in x_)})" for name, x_ in named)

    def _nonsense(self, function: str) -> ModelError:
        """End a process that wrote into the pipe to its parent, and return the error."""
        self.close()
        return ModelError(self.name, function, "writes into the pipe by which its process answers")

    def _died(self, function: str) -> ModelError:
        """Return the error of a process that is no more."""
        self._process.join(1.0)  # the pipe ends a moment before the process
        code = self._process.exitcode
        if code == _CUT:
            return ModelError(self.name, function, "closes file descriptors that are not its own")
        if code == _BROKEN:
            text = "breaks the Python it runs in: does it replace builtins, or functions of NumPy?"
            return ModelError(self.name, function, text)
        how = f"with exit code {code}"
        if code is not None and code < 0:
            how = f"by {signal.Signals(-code).name}"
        return ModelError(self.name, function, f"ended its Python process {how}")


def _read_opening(answer: Any) -> tuple[list[str], int | None, bool, str | None, tuple[str, ...]]:
    """Return what a process says of the model that it has read, checked."""
    functions, n, printed, source, uncompared = answer
    good = all(isinstance(name, str) for name in [*functions, *uncompared])
    if not good or not isinstance(source, str | None) or not isinstance(n, int | None):
        raise ValueError
    return list(functions), n, bool(printed), source, tuple(uncompared)


def _read_call(answer: Any) -> tuple[Array, bool, float]:
    """Return the numbers of a call, whether the model has printed, and how long it took [s]."""
    shape, numbers, printed, took = answer
    if len(numbers) > _MOST_NUMBERS:
        raise ValueError
    return (
        np.array(numbers, dtype=np.float64).reshape([int(size) for size in shape]),
        bool(printed),
        float(took),
    )


def _read_repaired(answer: Any) -> search.Repaired | None:
    """Return changes of a source that were sent as JSON."""
    if answer is None:
        return None
    changes, source, doubts, checked, other, sure, standing, spelled, odd = answer
    made = [
        edits.Change(kind, tuple(span), old, new, where, name, bits, frozenset(reaches))
        for kind, span, old, new, where, name, bits, reaches in changes
    ]
    rates = {int(k): {int(j): float(rate) for j, rate in each} for k, each in standing}
    numbers = (int(doubts), int(checked), int(other), bool(sure))
    return search.Repaired(tuple(made), source, *numbers, rates, str(spelled), tuple(map(str, odd)))


def _plain_repaired(found: search.Repaired | None) -> Any:
    """Return changes of a source as JSON has them; see :func:`_read_repaired`."""
    if found is None:
        return None
    changes = [[*change[:-1], sorted(change.reaches)] for change in found.changes]
    standing = [[int(k), [[int(j), float(x)] for j, x in each.items()]] for k, each in found.standing.items()]
    numbers = [int(found.doubts), int(found.checked), int(found.other), bool(found.sure)]
    return [changes, found.source, *numbers, standing, found.spelled, list(found.odd)]


def _send(pipe: Any, good: bool, answer: Any) -> None:
    """Send an answer as JSON."""
    pipe.send_bytes(json.dumps([good, answer], default=_plain_number).encode())


def _plain_number(value: Any) -> Any:
    """Return a number of NumPy as one of Python."""
    return value.item()


class _Silent(io.TextIOBase):
    """Takes what a model prints and remembers that it did."""

    used = False

    def write(self, text: str) -> int:
        self.used = True
        return len(text)


def _serve(
    parents: Any, pipe: Any, model: Any, source: str | None, convention: Convention | None, started: Any
) -> None:
    """Answer for the model in the child: read it, then answer calls until the parent goes away."""
    try:
        parents.close()  # or the child would never see that the parent is gone
        own, silent = os.getpid(), _isolate(model)
        try:
            functions = models.resolve(model, source, convention)
            _end_copies(own)
            text = functions.origin.source if functions.origin is not None else None
            opening = [list(functions.calls), functions.n, silent.used, text, list(functions.uncompared)]
            _send(pipe, True, opening)
        except BaseException as error:
            _end_copies(own)
            _send(pipe, False, _description(error))
            os._exit(0)
        while True:
            try:
                name, given = pipe.recv()
            except EOFError:
                os._exit(0)
            if not name:
                found = _search(functions, lambda s: models.resolve(model, s, convention), *given)
                _send(pipe, True, _plain_repaired(found))
                os._exit(0)
            _answer_calls(pipe, functions, name, given, silent, own, started)
    except OSError:  # the pipe is gone
        os._exit(_CUT)
    finally:
        os._exit(_BROKEN)  # not sys.exit: no handler of the parent's may run twice


def _isolate(model: Any) -> _Silent:
    """Take from the process its parent's group, signals, streams and arguments, and limit its memory."""
    with suppress(OSError):
        os.setsid()  # a group of its own: what the model starts ends with it
    for number in signal.valid_signals():
        # A handler of the program that we run in (a test runner's alarm, say) must not run for the model.
        if callable(signal.getsignal(number)):
            signal.signal(number, signal.SIG_DFL)
    with suppress(OSError, ValueError):
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
    functions: models.Functions, again: search.Again, goal: edits.Goal, known: Sequence[float], budget: float
) -> search.Repaired | None:
    """Return changes of a source with which the model gives what it should, None without such."""
    origin = functions.origin
    try:
        if origin is None or not edits.harmless(origin.source):
            return None
        if budget == 0.0:
            return search.vary_numbers(functions, again, goal)
        np.cross = edits.cross  # this process ends with the search
        functions = _as_graph(functions, again, goal)
        until = time.process_time() + budget
        return search.find_repair(functions, again, goal, known, until, extra=budget >= search.BUDGET)
    except Exception:
        return None  # a source that is too odd to be changed


def _as_graph(functions: models.Functions, again: search.Again, goal: edits.Goal) -> models.Functions:
    """Return a model read anew, drawn as a graph, which is changed fast, if that gives the same.

    Anew, as `from numpy import cross` has another one.
    """
    origin = functions.origin
    assert origin is not None
    if not {"sympy", "casadi"} & sys.modules.keys():
        return again(origin.source)
    names = [name for name, target in goal.targets.items() if target.whole]
    real = [goal.call(functions.calls, name, edits.ALL, 0) for name in names]
    uninstall = graph.install()
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
    pipe: Any,
    functions: models.Functions,
    name: str,
    states: Sequence[Sequence[Array]],
    silent: _Silent,
    own: int,
    started: Any,
) -> None:
    """Answer one list of calls up to the first that fails; `own` is the process that may."""
    try:
        function = functions.calls[name]
        answers, sent = [], time.perf_counter()
        for state in states:
            started.value += 1
            given = [np.array(x) for x in state]  # copies, so that a change is seen
            start = time.perf_counter()
            value = _numbers(function(*given))
            _end_copies(own)
            for label, x, before in zip(models.ARGUMENTS[name], given, state, strict=True):
                if not np.array_equal(x, before):
                    raise models.Unusable(f"changes its argument {label} in place; let it work on a copy")
            now = time.perf_counter()
            answers.append((value.shape, value.ravel().tolist(), silent.used, now - start))
            if now - sent > _TOGETHER:
                _send(pipe, True, answers)
                answers, sent = [], now
        if answers:
            _send(pipe, True, answers)
    except BaseException as error:
        _end_copies(own)
        _send(pipe, False, _description(error))


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
