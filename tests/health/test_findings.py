"""Findings: of many that are alike one is said, with all names, a range of all numbers, and one option."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
import pytest

from armgpi.cli.parsing import as_option
from armgpi.errors import Remedy
from armgpi.health import findings
from armgpi.health.findings import Finding


def test_what_holds_of_several_joints_is_said_once_with_ranges_and_one_option_for_all() -> None:
    found = [
        Finding(
            "warning", f"joint {name!r}", f"needs {most} of 10", remedies=(Remedy("effort", (name,), most),)
        )
        for name, most in (("j2", 12.5), ("a", 20.0), ("b", -3e-05))
    ]
    (one,) = findings.fold(found)
    assert str(one) == "each of joints 'j2', 'a', 'b': needs -3e-05 to 20.0 of 10"
    assert as_option(one.remedies[0]) == "--effort j2=12.5,a=20,b=-3e-05"
    other = found[0]._replace(message="needs 12.5 of it")
    assert findings.fold([found[0], other]) == [found[0], other]
    lowest = [
        each._replace(remedies=(Remedy("omega", (), x),))
        for each, x in zip(found, (3.0, 1.0, 2.0), strict=True)
    ]
    assert findings.fold(lowest)[0].remedies == (Remedy("omega", (), 1.0),)


def draws(seed: int) -> list[Finding]:
    """Return findings of joints as checks make them, some of them alike but for name and number."""
    rng = np.random.default_rng(seed)
    found = []
    for place in range(int(rng.integers(1, 40))):
        kind = str(rng.choice(["effort", "range", "damping"]))
        level = findings.LEVELS[int(rng.integers(3))]
        value = round(float(rng.normal()), 3)
        message = f"{kind} needs {value} of {int(rng.integers(1, 3))}"
        remedy = Remedy("effort", (f"j{place}",), abs(value))
        found.append(Finding(level, f"joint 'j{place}'", message, value, 1.0, "more", (remedy,), kind))
    return found


def joints_of(found: list[Finding]) -> set[str]:
    """Return the joints that remedies name, in options with a value for each."""
    names: set[str] = set()
    for finding in found:
        for remedy in finding.remedies:
            names.update(remedy.joints)
            names.update(re.findall(r"(j\d+)=", str(remedy.value)))
    return names


@pytest.mark.parametrize("seed", range(40))
def test_folding_leaves_out_no_level_kind_or_number(seed: int) -> None:
    every = draws(seed)
    folded = findings.fold(every)
    levels = [findings.LEVELS.index(finding.level) for finding in folded]
    assert levels == sorted(levels)
    assert {finding.level for finding in folded} == {finding.level for finding in every}
    assert len(folded) <= len(every)
    # Every number of a message is within a range that is said of its level and kind, or counted as one more.
    for finding in every:
        alike = [x for x in folded if (x.level, x.kind) == (finding.level, finding.kind)]
        number = finding.value
        assert isinstance(number, float)
        ranges = [[float(x) for x in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", x.message)] for x in alike]
        said = any(min(ends) <= number <= max(ends) for ends in ranges if ends)
        assert said or any(x.kind == finding.kind and "more of this kind" in x.message for x in folded)


@pytest.mark.parametrize("seed", range(40))
def test_findings_that_are_alike_are_one_whatever_their_order(seed: int) -> None:
    every = draws(seed)
    backwards = findings.fold(every[::-1])
    forwards = findings.fold(every)
    assert Counter(x.level for x in forwards) == Counter(x.level for x in backwards)
    if not any(finding.kind == "others" for finding in forwards):
        assert joints_of(forwards) == joints_of(backwards) == joints_of(every)


def test_a_single_finding_is_said_as_it_is() -> None:
    for finding in draws(1)[:1]:
        assert findings.fold([finding]) == [finding]
        assert findings.fold([]) == []


def test_the_checks_of_some_kinds_run_those_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []

    def of(kind: str) -> findings.Check:
        def function(subject: object) -> list[Finding]:
            ran.append(kind)
            return [Finding("info", "robot", kind)]

        return findings.Check(kind, kind, ("info",), function)

    monkeypatch.setattr(findings, "CHECKS", [of("a"), of("b"), of("c")])
    monkeypatch.setattr("armgpi.registry.load_plugins", lambda: None)
    found = findings.find(None, {"a", "c"})
    assert ran == ["a", "c"]
    assert [finding.kind for finding in found] == ["a", "c"]
    assert [finding.kind for finding in findings.find(None)] == ["a", "b", "c"]
