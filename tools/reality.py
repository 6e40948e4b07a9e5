"""Run laws on draws of a reality over a list of arms, and print how many were lost, hunt or chatter.

Usage:
    python tools/reality.py --count 1500 --arms fit
    python tools/reality.py --count 200 --arms held-out --laws gpi adrc '{type: gpi, rolloff: 1}'
    python tools/reality.py --arms ur5 panda z1 --count 240 --laws gpi_auto --only --reality elastic
    python tools/reality.py --arms ur5 panda --laws gpi --reality bare --seed 1 --out found.json
    python tools/reality.py --arms ur5 --laws gpi_auto --only --reality undriven --change '{rotor_common: 5}'

The first row is the law of version 0.1, `gpi` with its defaults. Intervals are Wilson's, of
95 %. Draws of one arm are alike, and so are those that share a sample time: for a new arm the intervals are
somewhat too narrow.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from armgpi import ArmgpiWarning, Reality, Robot, config
from armgpi.base.escape import markdown_table
from armgpi.base.parameter import parameters
from armgpi.errors import ArmgpiError, ParameterError
from armgpi.health import reality as health
from armgpi.health.zoo import fingers
from armgpi.plants.reality import Scenario
from armgpi.robot import robots

KINDS = parameters(Reality)["name"].choices
#: Arms that are part of a larger robot belong to the family of the arm.
_FAMILIES = {"anymal": "kinova", "b1": "z1"}


def families() -> dict[str, list[str]]:
    """Return the arms of example-robot-data by family, both in alphabetical order.

    A family is the first word of the folder that the URDF is in.
    """
    found: dict[str, list[str]] = {}
    for name, arm in robots.EXAMPLE_ROBOT_DATA.items():
        family = arm.file.partition("_")[0]
        found.setdefault(_FAMILIES.get(family, family), []).append(name)
    return {family: sorted(found[family]) for family in sorted(found)}


def arms(part: str) -> list[str]:
    """Return the arms to choose a law's tuning with ("fit"), or to judge it with ("held-out").

    Families go to the one and the other by turns, in alphabetical order.

    Raises:
        ParameterError: when it is neither.
    """
    parts = ("fit", "held-out")
    if part not in parts:
        raise ParameterError("part", part, f"one of {', '.join(parts)}")
    return [name for names in list(families().values())[parts.index(part) :: 2] for name in names]


class Experiments(NamedTuple):
    """What laws came to.

    Attributes:
        found: law -> outcomes.
        failed: arms that could not be run, name -> reason.
    """

    found: dict[str, list[health.Outcome]]
    failed: dict[str, str]


def experiments(
    reality: Reality,
    names: Sequence[str],
    laws: Mapping[str, Mapping[str, Any]],
    count: int,
    told: Callable[[str], None] = lambda name: None,
    backend: str = "compiled",
    drives: Sequence[str | None] = (None,),
) -> Experiments:
    """Run laws on the same draws, shared out evenly over arms.

    Args:
        reality: what is drawn from.
        names: of the arms.
        laws: label -> section of an experiment file.
        count: number of draws in all; every arm gets the same, at least one.
        told: is given each arm's name before it is run.
        backend: as for :func:`armgpi.simulate`.
        drives: what each law believes where nothing is told; see :func:`armgpi.health.reality.draws`.
    """
    every = -(-count // max(len(names), 1))
    each = {
        label if len(drives) == 1 else f"{label}, {own}": (law, own)
        for label, law in laws.items()
        for own in drives
    }
    result = Experiments({label: [] for label in each}, {})
    for name in names:
        told(name)
        try:
            found = {own: health.draws(reality, name, every, own) for own in drives}
            holds = {draw.index: health.ideal_law_holds(draw) for draw in found[drives[0]]}
            rows = {
                label: health.outcomes(found[own], name, law, backend, holds)
                for label, (law, own) in each.items()
            }
        except ArmgpiError as error:
            result.failed[name] = str(error)
            continue
        for label, row in rows.items():
            result.found[label] += row
    return result


class Warned(NamedTuple):
    """What is said of a draw before it is run.

    Attributes:
        torque: whether the reference asks the nominal model for more torque than is known to be there.
        controller: whether the law warns when it is made.
    """

    torque: bool
    controller: bool


def said_of(draw: Scenario, law: Mapping[str, Any]) -> Warned:
    """Return what is said of a draw before it is run.

    Args:
        draw: the draw.
        law: a controller's section of an experiment file.

    Raises:
        ArmgpiError: when the law cannot be made for the arm.
    """
    target = draw.reference.at(np.linspace(0.0, draw.t_final, health.MOMENTS))
    asked = np.abs(draw.model.inverse_dynamics(*target)) / draw.model.limits.effort
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        config.controller(law, draw.context)
    return Warned(bool(asked.max() > 1.0), any(issubclass(each.category, ArmgpiWarning) for each in said))


def warned(drawn: Reality, found: Sequence[health.Outcome], law: Mapping[str, Any], label: str) -> str:
    """Return, as Markdown, of how many lost and holding draws something was said before they ran."""
    said = []
    for name, rows in groupby(found, lambda each: each.arm):
        robot = Robot.load(name, fingers(name))
        said += [said_of(drawn.draw(robot, each.index), law) for each in rows]
    lines = []
    kinds = {"torque": "torque of the move", "controller": "when the controller is made", "": "either"}
    for kind, text in kinds.items():
        one = [getattr(each, kind) if kind else any(each) for each in said]
        shares = (
            [warning for warning, each in zip(one, found, strict=True) if each.failed is lost]
            for lost in (True, False)
        )
        lines.append((text, *(health.share(each) for each in shares)))
    return markdown_table((f"{label}: warned of", "failed [%]", "holding [%]"), lines)


#: Classes of the delay of hold, transport and current loop: label -> least and most [s].
LAGS = {"T < 5 ms": (0.0, 5e-3), "T 5-8 ms": (5e-3, 8e-3), "T >= 8 ms": (8e-3, np.inf)}


def by_lag(found: Mapping[str, Sequence[health.Outcome]]) -> str:
    """Return, as Markdown, the draws that the motors can follow, by their delay, beside the first law."""
    head = ("delay", "law", "draws", "failed [%]", "hunting [%]", "chatter [%]", "final error", "ITAE ratio")
    lines = []
    reference = next(iter(found.values()))
    for label, (least, most) in LAGS.items():
        for law, rows in found.items():
            here = [each for each in rows if least <= each.lag < most and each.demand <= 1.0]
            if not here:
                continue
            shares = [
                health.share([getattr(x, key) for x in here]) for key in ("failed", "hunting", "chatter")
            ]
            error = f"{np.median([each.final_error for each in here]):.2g}"
            arms_ratios = list(health.itae_ratios(here, reference).values())
            ratio = f"{np.exp(np.mean(np.log(arms_ratios))):.3g}" if arms_ratios else "-"
            lines.append((label, law, str(len(here)), *shares, error, ratio))
    return markdown_table(head, lines)


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; 1 when no arm could be run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="draws in all")
    parser.add_argument("--arms", nargs="+", default=["fit"], help="fit, held-out, or names of arms")
    parser.add_argument("--laws", nargs="+", default=[], help="controllers beside gpi: types, or sections")
    parser.add_argument("--only", action="store_true", help="those laws alone, without gpi")
    parser.add_argument("--reality", default="geared", choices=KINDS)
    parser.add_argument("--drives", nargs="+", default=[None], choices=("stiff", "elastic"))
    parser.add_argument("--change", type=yaml.safe_load, default={}, help="parameters of the reality")
    parser.add_argument("--block", type=int, help="draws in a row that share sample time and delay")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", default="compiled", choices=("numpy", "compiled", "auto"))
    parser.add_argument("--warned", action="store_true", help="of which draws something is said beforehand")
    parser.add_argument("--per-arm", action="store_true", help="a table of arms for each law as well")
    parser.add_argument("--out", type=Path, help="write all outcomes as JSON")
    given = parser.parse_args(arguments)
    if unknown := ", ".join(set(given.change) - set(parameters(Reality))):
        parser.error(f"--change {unknown}: expected {', '.join(parameters(Reality))}")
    names = arms(given.arms[0]) if given.arms[0] in ("fit", "held-out") else given.arms
    laws = {} if given.only else {"gpi": {"type": "gpi"}}
    for text in given.laws:
        section = yaml.safe_load(text)
        laws[text] = section if isinstance(section, dict) else {"type": section}
    block = {} if given.block is None else {"block": given.block}
    drawn = Reality(given.reality, given.seed, **block, **given.change)
    done = experiments(
        drawn,
        names,
        laws,
        given.count,
        lambda name: print(name, file=sys.stderr, flush=True),
        given.backend,
        tuple(given.drives),
    )
    print(health.markdown(done.found))
    print("\ndraws within the torque limits, by delay; ITAE over that of the first law, geometric mean\n")
    print(by_lag(done.found))
    print("\nfeasible draws alone\n")
    print(health.markdown({label: [x for x in found if x.feasible] for label, found in done.found.items()}))
    draws = next(iter(done.found.values()))
    shares = {
        "infeasible": [not x.feasible for x in draws],
        "by torque": [x.demand > 1.0 for x in draws],
        "held by no law": [not x.held for x in draws],
    }
    print(", ".join(f"{name}: {health.share(row)} %" for name, row in shares.items()), "\n")
    for label, law in laws.items():
        print(f"{label}: measures {health.describe_knowledge(law)}")
    if given.warned:
        for label, law in laws.items():
            print(f"\n{warned(drawn, done.found[label], law, label)}", end="")
    if given.per_arm:
        for label, found in done.found.items():
            by_arm = {name: [each for each in found if each.arm == name] for name in names}
            print(f"\n{label}\n\n{health.markdown({k: v for k, v in by_arm.items() if v}, 'arm')}")
    for name, reason in done.failed.items():
        print(f"not run: {name}: {reason}")
    if given.out:
        rows = {label: [each._asdict() for each in found] for label, found in done.found.items()}
        data = {"reality": drawn.describe(), "laws": laws, "outcomes": rows, "failed": done.failed}
        given.out.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return 0 if any(done.found.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
