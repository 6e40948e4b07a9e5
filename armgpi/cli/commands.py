"""The list of all commands; the module of each is imported when it is asked for.

So ``armgpi --help`` waits for none of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from armgpi.cli.layout import WIDEST, Command
from armgpi.cli.options import with_rows


class Entry(NamedTuple):
    """A command as the list of all shows it.

    Attributes:
        group: in --help.
        module: in which its function is, below ``armgpi.cli``.
        summary: the first line of its help.
        declares: whether it has an option for every declared parameter.
    """

    group: str
    module: str
    summary: str
    declares: bool = False


#: Group of --help -> command, module of its function below ``armgpi.cli``, and * where it has an option for
#: every declared parameter -> first line of its help.
_TABLE = {
    "Simulate": {
        "run experiment *": "Simulate one controller on a robot and print how well it tracked.",
        "compare experiment *": "Simulate several controllers on the same robot and print one table.",
        "sweep sweep": "Run an experiment many times with drawn numbers and say how often it fails, with "
        "intervals.",
        "play play *": "Write a page in which the loop is simulated anew when one of its knobs is turned.",
        "zoo zoo": "Run every arm that can be loaded with default gains, empty and loaded, and print one "
        "table.",
        "tune tune": "Search for the numbers of a controller, and validate what is found on scenarios that "
        "it never saw.",
        "contend contend": "Tune every law alike, for several budgets of torque variation, and judge them on "
        "what none has seen.",
    },
    "Robots": {
        "robots robots": "List the robots that can be loaded by name.",
        "new new": "Begin an experiment file for an arm: what its URDF says, and what you say or armgpi "
        "believes.",
        "inspect inspect": "Report what a robot's model is, what will bite, and what a controller will do "
        "with it.",
        "view view": "Show robots, or play a rollout, in MeshCat: at an address of this machine alone, or as "
        "one file.",
    },
    "Results": {
        "report view": "Write tables, plots, animation and data of rollouts as one HTML file, or as a log "
        "for other programs.",
    },
    "Hand-derived dynamics": {
        "validate validate": "Compare hand-derived dynamics with Pinocchio's and say what is wrong with "
        "them.",
        "derive derive": "Derive D, C and G of an arm of up to four joints in closed form.",
    },
    "Certificates": {
        "certify certify": "Bound the whole arm's error under GPI, so that another program can check it "
        "exactly.",
        "bound bound": "Bound the error along the reference of an experiment, in millimetres at the tool.",
    },
    "Hardware": {
        "excite identify": "Write a motion from which an arm can be identified, and the experiment that runs "
        "it.",
        "identify identify": "Identify an arm from logs of measured positions and commanded torques.",
        "export export *": "Write a controller as freestanding C99 for hardware, with a log to replay.",
        "loop loop *": "Run arm and controller as two processes over UDP, in wall-clock time, with faults.",
        "bringup bringup": "Write the stages from a dry run to full speed, each with its caps, or judge "
        "their logs.",
        "log log": "Say what a log of an arm is: how long, what was late, why it ended; replay it through "
        "the law.",
    },
    "The paper": {
        "reproduce paper": "Run the paper again: Tables 2-4 and Figures 5-13, published beside ours, and "
        "what it leaves open.",
        "scenarios paper": "List the paper's scenarios, or print one as an experiment file to edit.",
    },
    "Installation": {
        "doctor doctor": "Check the installation: which Pinocchio is imported, which extras are there, what "
        "is in the way.",
    },
}


def _entries() -> Iterator[tuple[str, Entry]]:
    for group, rows in _TABLE.items():
        for key, summary in rows.items():
            name, module, *declares = key.split()
            yield name, Entry(group, module, summary, bool(declares))


ENTRIES = dict(_entries())


class _Loaded(Mapping[str, Any]):
    """The commands by name; each is imported when it is asked for."""

    def __init__(self) -> None:
        """Begin without any."""
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """Return a command."""
        if name not in self._made:
            self._made[name] = _build_command(name, ENTRIES[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(ENTRIES)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(ENTRIES)


def _build_command(name: str, entry: Entry) -> Any:
    """Return a command as the library of the command line has it: the only one of an app of its own."""
    module = import_module(f"armgpi.cli.{entry.module}")
    function = with_rows(getattr(module, name), getattr(module, "ROWS", {}))
    kind: type[Command] = Command
    if entry.declares:
        from armgpi.cli.declared import DeclaredCommand

        kind = DeclaredCommand
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(name, cls=kind, rich_help_panel=entry.group)(function)
    return typer.main.get_command(app)


class Commands(TyperGroup):
    """The commands in groups, each with its whole summary."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Make the group."""
        settings = options.pop("context_settings", None) or {}
        settings.setdefault("max_content_width", WIDEST)
        super().__init__(*arguments, context_settings=settings, **options)
        vars(self)["commands"] = _Loaded()

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for every group of commands."""
        widest = max(map(len, ENTRIES))
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, entry in ENTRIES.items():
            groups.setdefault(entry.group, []).append((name.ljust(widest), entry.summary))
        for group, rows in groups.items():
            with formatter.section(group):
                formatter.write_dl(rows)
