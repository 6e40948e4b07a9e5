"""What findings propose is tried before it is said: the arm loads with it, and the finding is gone."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence

from armgpi.errors import ArmgpiError, Finding, Remedy

#: Kinds of remedies that can be tried; the others name what only the user has, such as a folder of meshes.
_TRIED = ("lock", "effort", "mimic", "repair")

#: Trials of one kind at most: an arm can have 64 joints, and each trial loads it. What was not tried is not
#: proposed.
_MOST = 16

#: Loads the arm once more with some remedies applied, and returns what the checks of some kinds find then.
Again = Callable[[Sequence[Remedy], Container[str]], Iterable[Finding]]


def with_what_helps(findings: Sequence[Finding], again: Again) -> list[Finding]:
    """Return findings without those of their remedies that do not help.

    All remedies of one kind are tried together. Where that does not help, one after the other: each is kept
    that helps together with those before it, as they are typed together.

    Args:
        findings: what was found.
        again: loads the arm with some remedies applied, and runs the checks of some kinds.
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
        helpful: list[tuple[int, Remedy]] = []
        for each in proposed[:_MOST] if len(proposed) > 1 else []:
            if _help([*helpful, each], findings, again):
                helpful.append(each)
        useless |= {*proposed} - {*helpful}
    return [
        finding._replace(remedies=tuple(x for x in finding.remedies if (place, x) not in useless))
        for place, finding in enumerate(findings)
    ]


def _help(proposed: Sequence[tuple[int, Remedy]], findings: Sequence[Finding], again: Again) -> bool:
    """Tell whether the findings of some remedies are gone once these are applied."""
    remedies = dict.fromkeys(remedy for _, remedy in proposed)
    asked = {(each.kind, each.where, each.level) for each in (findings[place] for place, _ in proposed)}
    try:
        found = again([*remedies], {kind for kind, _, _ in asked})
    except ArmgpiError:  # the arm does not load with them
        return False
    return not asked & {(each.kind, each.where, each.level) for each in found}
