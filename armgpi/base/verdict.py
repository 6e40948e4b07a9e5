"""A verdict of what was judged, never greener than that: exit code, first line, colour of a page and JSON.

What the user supplied or asked for and what nothing judged makes a verdict one *for part*. Limits of a method
are no such thing: they stand in the text.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

Outcome = Literal["holds", "holds for part", "fails", "not judged"]

#: Outcome -> exit code of a command, and class of the line on a page.
_CODES: Mapping[Outcome, int] = {"holds": 0, "holds for part": 3, "fails": 1, "not judged": 3}
_CLASSES: Mapping[Outcome, str] = {
    "holds": "good",
    "holds for part": "fair",
    "fails": "bad",
    "not judged": "fair",
}
#: What is left out that a line names; the rest are counted.
_NAMED = 3


class Verdict(NamedTuple):
    """What was found of what was asked.

    Attributes:
        outcome: whether it holds: all of it, the part that was judged, or not; or nothing was judged.
        text: the result in words.
        left_out: what was supplied or asked for and not judged, a phrase each.
        option: that of a command which accepts a verdict for part.
        accepted: whether the user accepts that something was left out.
    """

    outcome: Outcome
    text: str
    left_out: tuple[str, ...] = ()
    option: str = "--allow-part"
    accepted: bool = False

    @property
    def exit_code(self) -> int:
        """0 where it holds, 1 where it fails, 3 where something was not judged and that is not accepted."""
        return 0 if self.outcome == "holds for part" and self.accepted else _CODES[self.outcome]

    @property
    def page_class(self) -> str:
        """Class of the line on a page: "good", "fair" or "bad"."""
        return _CLASSES[self.outcome]

    @property
    def line(self) -> str:
        """The result in a line; it begins with INCOMPLETE or NOT JUDGED where something was left out."""
        if self.outcome not in ("holds for part", "not judged"):
            return self.text
        more = len(self.left_out) - _NAMED
        named = "; ".join(self.left_out[:_NAMED]) + (f"; and {more} more" if more > 0 else "")
        listed = f"; not judged: {named}" if named else ""
        if self.outcome == "not judged":
            return f"NOT JUDGED: {self.text}{listed} (exit code {self.exit_code})"
        how = f"{self.option} accepts this"
        if self.accepted:
            return f"INCOMPLETE: {self.text}{listed} (accepted by {self.option})"
        return f"INCOMPLETE: {self.text}{listed} (exit code {self.exit_code}; {how})"

    def plain(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        return {
            "outcome": self.outcome,
            "text": self.text,
            "left_out": list(self.left_out),
            "accepted": self.accepted,
            "exit_code": self.exit_code,
        }


def judge(
    holds: bool,
    text: str,
    left_out: Iterable[str] = (),
    option: str = "--allow-part",
    accepted: bool = False,
) -> Verdict:
    """Return the verdict of what was judged: a failure stays one, and what was left out makes it for part."""
    missing = tuple(left_out)
    outcome: Outcome = "fails" if not holds else "holds for part" if missing else "holds"
    return Verdict(outcome, text, missing, option, accepted)
