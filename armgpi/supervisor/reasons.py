"""What is behind each reason of a fault, and what to do: one table for messages, exports and docs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from armgpi.base.escape import markdown_table
from armgpi.supervisor.state import Reason

#: Where the table is.
PAGE = "docs/reasons.md"


class Cause(NamedTuple):
    """What is behind a reason.

    Attributes:
        when: the check, as exported code says it.
        cause: what it mostly is.
        remedy: what to do.
    """

    when: str
    cause: str
    remedy: str


REASONS = {
    Reason.NONE: Cause("there is no fault", "nothing", "go on"),
    Reason.BEFORE_INIT: Cause(
        "step came before init",
        "the program",
        "call init once, with the first measurement, before the brakes open",
    ),
    Reason.LATE: Cause(
        "more samples were missed than may be",
        "scheduling, the network, another sample time than the robot's",
        "run in real time (docs/loop.md); `armgpi log` counts them; `missed` where so many are usual",
    ),
    Reason.SATURATED: Cause(
        "a torque was at its limit for too long",
        "a load or a motion that the motor cannot carry, a blocked joint, a limit in another unit",
        "move slower, specify the payload; move the joint by hand; check the effort limits in the file",
    ),
    Reason.FOLLOWING: Cause(
        "a position is too far from the reference",
        "a start away from the reference, an external push, a dead motor or one of reversed sign, an "
        "unstable loop",
        "begin where the arm is; after a push continue; otherwise test the joint alone again "
        "(docs/bringup.md)",
    ),
    Reason.REFERENCE: Cause(
        "the reference is not finite, or jumps",
        "a planner that steps, straight lines with corners, a file in another unit, ~/stop, Ctrl-C",
        "begin where the arm is, and move smoothly: `armgpi_move_to`, `Bezier`; `reference_step` for corners",
    ),
    Reason.POSITION: Cause(
        "a position is beyond its limits",
        "a wrong zero, degrees, another joint's position, a reference at the limit",
        "dry run; the joint back by hand or by the robot's own means; limits as the robot has them",
    ),
    Reason.FROZEN: Cause(
        "a position should have changed, and did not",
        "a cable, a bus that repeats, a closed brake, friction above `sticking`, a blocked joint",
        "move it by hand and look at its position; `sticking` for friction, `armgpi_step_late` for repeats",
    ),
    Reason.JUMP: Cause(
        "a position moved faster than its joint can",
        "a turn not unwrapped, noise above `resolution`, samples lost and not counted, an encoder",
        "unwrap; specify bits and noise; report missed samples by `armgpi_step_late`, or raise `jump`",
    ),
    Reason.NOT_FINITE: Cause(
        "a measurement, or the controller's torque, is not finite",
        "a driver that has no value yet, another unit",
        "start when all values are there; look at the first rows of the log",
    ),
    Reason.RESPONSE: Cause(
        "a joint accelerates against its torque",
        "reversed sign of a motor or its command, an arm that oscillates on elastic joints, a long push",
        "check the signs of torque and position; use `--drives elastic` for elastic joints",
    ),
    Reason.SPEED: Cause(
        "a joint is too fast",
        "an external push, a reversed sign, gravity not compensated or twice, a limit or stage limit "
        "that is too low",
        "look which way the torque pointed (`armgpi bringup check`)",
    ),
    Reason.CAP: Cause(
        "a torque differs from the model's holding torque by the limit",
        "in a commissioning stage: a joint that does not move, a payload, gravity, friction above "
        "the stage limit",
        "`armgpi bringup check` names the cause; if it is friction, raise the limit in the file of the stage",
    ),
    Reason.WORKSPACE: Cause(
        "the tool is outside its workspace",
        "a hand or a wall that pushes the tool away, a goal or a move that leads out of the box, a box in "
        "another frame or unit",
        "bring the tool back by hand, then continue; plan within the box (base frame, m)",
    ),
    Reason.TOOL_SPEED: Cause(
        "the tool is too fast",
        "an external push, something that was pressed against and gave way, a move that is too fast",
        "move slower; raise `tool_speed` where the counts of coarse encoders alone reach it",
    ),
    Reason.TOOL_FORCE: Cause(
        "the force on the tool is above its limit, whatever friction is",
        "a wall, a hand, a payload that the model does not have, more friction than assumed",
        "back away from what it touches, then continue; specify payload, friction or `uncertain_mass`",
    ),
}


def remedy(reason: str) -> str:
    """Return what to do about a reason by its name, in one line; "" for none."""
    cause = REASONS[Reason[reason.upper()]]
    if cause is REASONS[Reason.NONE]:
        return ""
    return f"{cause.when}. Mostly: {cause.cause}. {cause.remedy[0].upper()}{cause.remedy[1:]} ({PAGE})"


def table() -> str:
    """Return the causes and remedies of all reasons, as Markdown."""
    rows = [(f"`{reason.name}`", *cause) for reason, cause in REASONS.items() if reason]
    return markdown_table(("reason", "when", "mostly because of", "what to do"), rows)


def checks(when: Mapping[Reason, str]) -> str:
    """Return what one controller checks, as a list in Markdown.

    Args:
        when: reason -> its check in numbers; "" where the controller does not check it.
    """
    lines = [
        f"- `{reason.name}` is reported when {text}.\n"
        if text
        else f"- `{reason.name}` is not checked here.\n"
        for reason, text in when.items()
    ]
    return "".join(lines)
