"""The scenarios of sections 5.1 to 5.3: files that run, and say of every value whose it is."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

from armgpi import GPI, BSplineNetwork, CartesianReference, Waypoints, config, simulate
from armgpi.errors import NameNotFound
from armgpi.paper import scenarios
from armgpi.plants.loads import paper_disturbances

NAMES = scenarios.names()


def test_there_are_three() -> None:
    assert NAMES == ("scenario-5.1", "scenario-5.2", "scenario-5.3")
    with pytest.raises(NameNotFound, match=r"scenario-5\.3"):
        scenarios.locate("scenario-5.4")


@pytest.mark.parametrize("name", NAMES)
def test_every_value_is_marked_paper_or_ours(name: str) -> None:
    text = scenarios.locate(name).read_text(encoding="utf-8")
    lines = text.splitlines()
    tree = yaml.compose(text)

    def values(node: yaml.Node) -> list[int]:
        """Return the lines of all scalars that are values."""
        if isinstance(node, yaml.MappingNode):
            return [line for _, value in node.value for line in values(value)]
        if isinstance(node, yaml.SequenceNode):
            return [line for item in node.value for line in values(item)]
        return [node.start_mark.line]

    found = values(tree)
    assert len(found) > 15
    for line in found:
        assert re.search(r"# (paper|ours)\b", lines[line]), f"{name}:{line + 1}: {lines[line]}"


@pytest.mark.parametrize("name", NAMES)
def test_it_runs_as_it_stands(name: str) -> None:
    experiment = config.build(*config.read(scenarios.locate(name)))
    assert experiment.robot.name == "anthropomorphic3"
    assert experiment.config.sample_time == 1e-4
    for controller in experiment.controllers.values():
        rollout = simulate(experiment.plant, controller, experiment.reference, 0.02, progress=False)
        assert float(abs(rollout["q"] - rollout["q_ref"]).max()) < 1e-2


def test_what_is_marked_paper_is_what_the_paper_says() -> None:
    one, two, three = (config.build(*config.read(scenarios.locate(name))) for name in NAMES)
    for experiment in (one, two, three):
        proposal = experiment.controllers["GPI with networks"]
        assert isinstance(proposal, GPI)
        assert isinstance(proposal.gains, BSplineNetwork)
        # Four third-order functions, two for the error and two for its derivative.
        assert proposal.gains.basis.order == 3
        assert proposal.gains.size == 4
    assert isinstance(one.reference, Waypoints)
    assert isinstance(two.reference, CartesianReference)
    # Eq. 28 at t_k = pi / 4: the point by hand.
    there = two.robot.frame_pose("tool", two.reference.at(9.0 * np.pi / 4.0).q).translation
    np.testing.assert_allclose(there, [0.08 + 0.15 * np.pi / 16.0, -0.15 + 0.025, 0.4 - 0.05], atol=1e-9)
    t = np.linspace(0.0, 40.0, 201)
    expected = sum(load.torque(t[:, None]) for load in paper_disturbances())
    np.testing.assert_array_equal(three.plant.disturbance(t), expected)
    assert one.plant.disturbance(t) is None
    assert two.plant.disturbance(t) is None
