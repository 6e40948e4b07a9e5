"""The command line: parse, call one function, print a table, exit with a code.

Takes the words of a command.
Gives what rooms return, as tables, files and pages; what joins two leaves is here.

Exit codes: 0 fine, 1 what was asked failed (a rollout diverged, findings that stop a run, a model that
differs), 2 bad input, 3 something was not judged (:mod:`armgpi.base.verdict`), 130 interrupted,
143 terminated.
"""

from __future__ import annotations

import atexit
import gc
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from armgpi.base.escape import printable
from armgpi.cli.commands import Commands
from armgpi.cli.parsing import BAD_INPUT, INTERRUPTED, in_options, refusal, with_options
from armgpi.cli.terminal import lines_held, say

#: How often Python looks for garbage.
_USUAL = gc.get_threshold()


#: What Typer says of a value -> what was expected.
_EXPECTED = {
    "Input should be a valid number, unable to parse string as a number": "expected a number with a point, "
    "in SI units and without its unit (kg, m, rad, s): 30 deg is 0.5236, 5 ms is 0.005",
    "Input should be a valid integer, unable to parse string as an integer": "expected a whole number",
}


class _Commands(Commands):
    """The commands; what Click says of wrong options and arguments is shown as every other error is."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Read the options of armgpi itself."""
        with _usage_errors_as_ours():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Read the options of a command, and run it."""
        with _usage_errors_as_ours(), lines_held():
            return super().invoke(ctx)


@contextmanager
def _usage_errors_as_ours() -> Iterator[None]:
    """Raise a usage error as one of our own: one line, in which what cannot be seen is written out."""
    try:
        yield
    except Exception as error:
        # Of Click, which Typer may have a copy of; without a command its message is the whole help.
        if not hasattr(error, "format_message") or type(error).__name__ == "NoArgsIsHelpError":
            raise
        context = vars(error).get("ctx")
        command = "armgpi"
        if context is not None and context.parent is not None:
            command = f"armgpi {context.info_name}"
        raise refusal(*_usage_error(error, command)) from None


def _usage_error(error: Exception, command: str) -> tuple[str, str]:
    """Return the option or argument that Click refuses, empty where it is none, and what is wrong with it."""
    kind, facts = type(error).__name__, vars(error)
    said = printable(facts["message"] or "").rstrip(".")
    see = f"see {command} --help"
    if kind == "NoSuchOption":
        near = _near_options(facts["option_name"], facts["possibilities"], facts.get("ctx"))
        return "", f"{_unknown_option(printable(facts['option_name']), near)}; {see}"
    if kind == "MissingParameter":
        return _option_name(facts), f"is missing; {see}"
    if kind == "BadParameter":
        for theirs, ours in _EXPECTED.items():
            said = said.replace(theirs, ours)
        return _option_name(facts), f"{said}; {see}"
    if extra := re.match(r"Got unexpected extra argument\S* \((.*)\)", said):
        return "", f"{command} takes {_arguments(facts.get('ctx'))}, so {extra[1]!r} is too much; {see}"
    if needs := re.match(r"Option '(.*)' requires an argument", said):
        return needs[1], f"needs a value after it; {see}"
    said = re.sub(
        r"^No such command (.*)\. Did you mean (.*)\?", r"There is no command \1 (did you mean \2?)", said
    )
    said = re.sub(r"^No such command", "There is no command", said)
    return "", f"{said[:1].lower()}{said[1:]}; {see}"


def _option_name(facts: dict[str, Any]) -> str:
    """Return the option or argument that an error of Click is about, as its help shows it."""
    hint = facts.get("param_hint") or (facts["param"].get_error_hint() if facts.get("param") else "")
    names = [hint] if isinstance(hint, str) else list(hint)
    return " / ".join(names).replace("'", "")


#: Options that users of other programs type -> those here that may mean the same.
_OTHER_WORDS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("--count", "--samples", "--runs", "--trials", "--number"), ("--rollouts",)),
    **dict.fromkeys(("--iterations", "--budget", "--generations"), ("--evaluations",)),
    **dict.fromkeys(("--load", "--mass"), ("--payload",)),
    **dict.fromkeys(("--bandwidth", "--natural-frequency"), ("--omega",)),
    **dict.fromkeys(("--duration", "--time", "--seconds"), ("--t-final",)),
    **dict.fromkeys(("--bits", "--resolution", "--encoder"), ("--encoder-bits",)),
    **dict.fromkeys(("--rate", "--frequency", "--timestep", "--period", "--sample-time"), ("--dt",)),
    **dict.fromkeys(("--output", "--folder", "--file", "--dest", "--save"), ("--out",)),
    **dict.fromkeys(("--latency", "--lag"), ("--delay",)),
    **dict.fromkeys(("--goal", "--target-position"), ("--to",)),
    **dict.fromkeys(("--law", "--type"), ("--controller", "--controllers")),
    **dict.fromkeys(("--html", "--page"), ("--report",)),
    **dict.fromkeys(("--verbose", "--details"), ("--explain",)),
    **dict.fromkeys(("--jobs", "--processes"), ("--workers",)),
}


def _near_options(name: str, near: Sequence[str] | None, context: Any) -> Sequence[str] | None:
    """Return what a command may have in place of an option that it does not have.

    Args:
        name: as it was typed.
        near: options that are spelled alike.
        context: of Click.
    """
    parameters = [] if context is None else context.command.params
    own = {option for parameter in parameters for option in parameter.opts}
    return [option for option in _OTHER_WORDS.get(name, ()) if option in own] or near


def _unknown_option(name: str, near: Sequence[str] | None) -> str:
    """Return the sentence on an option that does not exist."""
    if name[1:2] != "-":
        return f"there is no option {name}; names of options have two dashes, such as --payload"
    proposed = f" (did you mean {' or '.join(sorted(near))}?)" if near else ""
    return f"there is no option {name}{proposed}"


def _arguments(context: Any) -> str:
    """Return which arguments a command takes."""
    words = [] if context is None else context.command.collect_usage_pieces(context)
    names = [word.strip("[]") for word in words if not word.startswith("[OPTIONS")]
    if not names:
        return "no argument"
    return f"one argument, {names[0]}" if len(names) == 1 else f"the arguments {' '.join(names)}"


app = typer.Typer(
    cls=_Commands,
    help="Torque control of any robot arm from its URDF and measured positions alone.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: it may speak of units in [brackets]
)


def _show_version(wanted: bool) -> None:
    """Print the version and exit."""
    if wanted:
        from armgpi import __version__

        say(f"armgpi {__version__}")
        raise typer.Exit()


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            metavar="",
            callback=_show_version,
            is_eager=True,
            help="Show the version and exit.",
        ),
    ] = False,
) -> None:
    """Take the options of armgpi itself."""


def _terminable(command: Callable[[], None]) -> None:
    """Run a command so that SIGTERM ends it as Ctrl-C does, each with an exit code of its own.

    Ctrl-C is ignored by what a shell starts in the background; SIGTERM, which schedulers send, is not.
    A signal counts wherever it arrives: also while the handlers are set, and set back.
    """
    received: list[int] = []

    def stop(number: int, _: object) -> None:
        received.append(number)
        raise KeyboardInterrupt

    handled = [signal.SIGTERM]
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        handled.append(signal.SIGINT)
    usual = {number: signal.getsignal(number) for number in handled}
    try:
        try:
            for number in handled:
                signal.signal(number, stop)
            command()
        finally:
            for number, handler in usual.items():
                signal.signal(number, handler)
    except BaseException as end:
        # What is interrupted may fail with another error: a library's import, a file that is being closed.
        if received and not (isinstance(end, SystemExit) and not end.code):
            sys.exit(128 + received[0])
        raise


def _collect_late() -> None:
    """Let Python look for garbage after 100,000 new objects only, and then as usual; and not at the end.

    Imports make 60,000 that stay. Looking through them again and again takes a quarter of a start.
    """

    def as_usual(*_: object) -> None:
        gc.callbacks.remove(as_usual)
        gc.set_threshold(*_USUAL)

    gc.callbacks.append(as_usual)
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)


def _warnings_shown_once() -> Callable[..., None]:
    """Return what shows a warning as one line, and of those that say the same only the first."""
    from armgpi.errors import ArmgpiWarning

    told: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        ours = issubclass(category, ArmgpiWarning)
        text = in_options(str(message)) if ours else str(message)
        what = text.partition(": ")[2]  # of a copy of the file it is told no second time
        if what not in told:
            say(f"warning: {text}" if ours else text, err=True, fg="yellow")
        told.update(filter(None, [what]))

    return show


def _run() -> None:
    """Run the command that the arguments name; what it raises becomes one line and an exit code."""
    from armgpi.errors import ArmgpiError

    try:
        app()
    except ArmgpiError as error:
        say(f"error: {with_options(error)}", err=True, fg="red")
        sys.exit(BAD_INPUT)
    except ImportError as error:  # a broken installation
        say(f"error: {error}; `armgpi doctor` checks what is installed", err=True, fg="red")
        sys.exit(BAD_INPUT)
    except OSError as error:  # the output mostly: files have errors of their own
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (so that nothing is flushed at the end)
        what = f"use {error.filename}" if error.filename else "write the output"
        say(f"error: cannot {what}: {error.strerror or error}", err=True, fg="red")
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        say("interrupted", err=True, fg="yellow")
        sys.exit(INTERRUPTED)


def main() -> None:
    """Run the command line; every error of ours becomes one line and an exit code."""
    from armgpi.errors import ArmgpiWarning

    _collect_late()
    if sys.stdout is None:  # closed by whoever called
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        # A terminal that has no "²" shows "?" instead.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    with warnings.catch_warnings():
        warnings.showwarning = _warnings_shown_once()
        warnings.simplefilter("ignore", RuntimeWarning)  # NumPy's: what comes of them is told by our checks
        warnings.simplefilter("default", ArmgpiWarning)
        _terminable(_run)
