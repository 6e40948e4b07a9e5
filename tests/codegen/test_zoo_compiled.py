"""Arms of the zoo with everything a loop can have: generated code agrees with NumPy up to an encoder's edge.

Some arms only, for time; tools/compiled_agreement.py has them all, at every width.
"""

from __future__ import annotations

import numpy as np
import pytest
from arms import experiment
from loops import Agreement, agreement, compiled
from sampling import for_search

from armgpi import robots, simulate

#: From small to large.
ARMS = [name for name in ("twodof", "anthropomorphic3", "ur5") if name in robots.names()]
SECONDS = 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [for_search(x) if x == "ur5" else x for x in ARMS])
def test_agreement_up_to_an_edge(name: str) -> None:
    case = experiment(name)
    arguments = (case.plant, case.controller, case.reference, SECONDS)
    by_numpy = simulate(*arguments, progress=False)
    got = compiled(*arguments)
    np.testing.assert_array_equal(got["status"], 0)
    apart = agreement(by_numpy, got, case.step_size)
    assert apart.before < 1e-9
    assert apart.counts <= 1.0
    assert apart.after < 10.0 * np.max(case.step_size)


@pytest.mark.parametrize("name", ARMS[:2])
def test_without_an_encoder_nothing_but_rounding(name: str) -> None:
    case = experiment(name, encoder=False)
    arguments = (case.plant, case.controller, case.reference, SECONDS)
    apart = agreement(simulate(*arguments, progress=False), compiled(*arguments))
    assert apart.before < 1e-12


def test_the_arms_follow_their_references() -> None:
    # What is compared is a loop that works: an unstable one would double any rounding.
    case = experiment("anthropomorphic3")
    run = compiled(case.plant, case.controller, case.reference, SECONDS)
    assert float(np.abs(run["q"] - run["q_ref"]).max()) < 0.02


def test_the_comparison_finds_what_it_looks_for() -> None:
    case = experiment("anthropomorphic3")
    run = compiled(case.plant, case.controller, case.reference, 0.1)
    size = case.step_size
    assert size is not None
    assert agreement(run, run, size) == Agreement(0.0, 0, 0.0, 0.0)
    # Before an edge, at it by one count, at it by two, and after it.
    for at, by, expected in (
        (None, 0.0, Agreement(1e-6, 0, 0.0, 0.0)),
        (50, 1.0, Agreement(1e-6, 1, 1.0, 0.0)),
        (50, 2.0, Agreement(1e-6, 1, 2.0, 0.0)),
        (5, 1.0, Agreement(0.0, 1, 1.0, 1e-6)),
    ):
        other = run.copy(deep=True)
        other["q"][3, 20, 1] += 1e-6
        if at is not None:
            other["q_measured"][3, at, 2] += by * size[2]
        found = agreement(run, other, size)
        assert found[1:3] == expected[1:3]
        np.testing.assert_allclose((found.before, found.after), (expected.before, expected.after), rtol=1e-6)
    other["q"][0, 10] = np.nan
    assert agreement(run, other, size).before == np.inf
