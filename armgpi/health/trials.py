"""What findings propose is tried before it is said: the arm loads with it, and the finding is gone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from armgpi.errors import ArmgpiError, Finding, Remedy

#: Kinds of remedies that can be tried; the others name what only the user has, such as a folder of meshes.
_TRIED = ("lock", "effort", "mimic", "repair")

#: Inspects the arm once more with some remedies applied, and returns what is found then.
Again = Callable[[Sequence[Remedy]], Iterable[Finding]]


def with_what_helps(findings: Sequence[Finding], again: Again) -> list[Finding]:
    """Return findings without those of their remedies that do not help.

    All remedies of one kind are tried together, and one by one where that does not help.

    Args:
        findings: what was found.
        again: inspects the arm with some remedies applied.
    """
    useless: set[tuple[int, Remedy]] = set()
    for kind in _TRIED:
        proposed = [
            (place, remedy)
            for place, finding in enumerate(findings)
            for remedy in finding.remedies
            if remedy.kind == kind
        ]
        if not proposed or _help(proposed, findings, again):
            continue
        useless |= {each for each in proposed if len(proposed) == 1 or not _help([each], findings, again)}
    return [
        finding._replace(remedies=tuple(x for x in finding.remedies if (place, x) not in useless))
        for place, finding in enumerate(findings)
    ]


def _help(proposed: Sequence[tuple[int, Remedy]], findings: Sequence[Finding], again: Again) -> bool:
    """Tell whether the findings of some remedies are gone once these are applied."""
    remedies = dict.fromkeys(remedy for _, remedy in proposed)
    try:
        left = {(each.kind, each.where, each.level) for each in again([*remedies])}
    except ArmgpiError:  # the arm does not load with them
        return False
    asked = (findings[place] for place, _ in proposed)
    return not left & {(each.kind, each.where, each.level) for each in asked}
