"""What `inspect` proposes was tried: typed as it is printed, the arm loads and the finding is gone."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Callable, Container, Sequence
from pathlib import Path

import pytest
from commands import Answer

import armgpi
from armgpi import robots
from armgpi.cli.parsing import as_option
from armgpi.errors import Finding, LimitError, Remedy
from armgpi.health import report, trials

#: Arms with findings of many kinds: grippers, followers, weak and missing efforts, several arms.
ARMS = [
    "panda",
    "talos_left_arm",
    "pr2_left_arm",
    "baxter_left_arm",
    "tiago_dual_left_arm",
    "kinova",
    "z1",
    "so101",
]
#: Options that can be typed as they are; the others name what only the user has.
TYPED = ("lock", "effort", "mimic", "repair")


def fixtures() -> list[Path]:
    return sorted((Path(__file__).parents[1] / "fixtures" / "urdf_cases").glob("*.urdf"))


def proposals(found: report.HealthReport) -> list[tuple[Finding, Remedy]]:
    return [(each, remedy) for each in found.findings for remedy in each.remedies if remedy.kind in TYPED]


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_a_proposal_of_an_arm_works_as_it_is_printed(name: str, cli: Callable[..., Answer]) -> None:
    if name not in robots.names():
        pytest.skip("the robots extra is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
        found = proposals(report.inspect(name))
    for finding, remedy in found:
        done = cli("inspect", name, *shlex.split(as_option(remedy)), "--json")
        assert done.code in (0, 1), (remedy, done.err)
        again = f'"level": "{finding.level}", "where": "{finding.where}", "message"'
        kinds = re.findall(re.escape(again) + r'.*?"kind": "([a-z-]+)"', done.out)
        assert finding.kind not in kinds, (finding, remedy)


@pytest.mark.parametrize("path", fixtures(), ids=lambda path: path.stem)
def test_a_repair_that_is_proposed_loads_the_file(path: Path) -> None:
    try:
        report.inspect(path)
    except armgpi.ArmgpiError as error:
        for remedy in error.remedies:
            if remedy.kind == "repair" and remedy.value:
                report.inspect(path, repair=str(remedy.value))


def test_a_proposal_that_does_not_help_is_not_made() -> None:
    good, bad, refused = (Remedy("lock", (joint,)) for joint in ("a", "b", "c"))
    findings = [
        Finding("warning", f"joint {x.joints[0]!r}", "moves", kind="x", remedies=(x,))
        for x in (good, bad, refused)
    ]

    def again(remedies: object, kinds: Container[str]) -> list[Finding]:
        assert kinds == {"x"}  # other checks would take long for nothing
        locked = {joint for remedy in remedies for joint in remedy.joints}  # type: ignore[attr-defined]
        if "c" in locked:
            raise LimitError("a position", "c", 0.0, 1.0, 2.0)
        return [each for each in findings if not (each.where == "joint 'a'" and "a" in locked)]

    kept = trials.with_what_helps(findings, again)
    assert [each.remedies for each in kept] == [(good,), (), ()]


def test_what_is_proposed_helps_when_all_of_it_is_typed() -> None:
    """Each of three joints can be locked, but not all of them: then the arm has none."""
    findings = [
        Finding("warning", f"joint {name!r}", "cannot move", kind="x", remedies=(Remedy("lock", (name,)),))
        for name in "abc"
    ]

    def again(remedies: Sequence[Remedy], kinds: Container[str]) -> list[Finding]:
        locked = {joint for remedy in remedies for joint in remedy.joints}
        if len(locked) == len(findings):
            raise LimitError("a position", "c", 0.0, 1.0, 2.0)
        return [each for each in findings if each.remedies[0].joints[0] not in locked]

    kept = trials.with_what_helps(findings, again)
    assert [bool(each.remedies) for each in kept] == [True, True, False]


def test_arms_of_many_joints_are_loaded_a_bounded_number_of_times() -> None:
    """What was not tried is not proposed."""
    findings = [
        Finding("warning", f"joint '{k}'", "moves", kind="x", remedies=(Remedy("lock", (str(k),)),))
        for k in range(64)
    ]
    loaded = []

    def again(remedies: Sequence[Remedy], kinds: Container[str]) -> list[Finding]:
        loaded.append(len(remedies))
        if len(remedies) > 16:
            raise LimitError("a position", "c", 0.0, 1.0, 2.0)
        return []

    kept = trials.with_what_helps(findings, again)
    assert loaded == [64, *range(1, 17)]
    assert [bool(each.remedies) for each in kept] == [True] * 16 + [False] * 48
