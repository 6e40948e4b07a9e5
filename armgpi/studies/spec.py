"""The section `tune` of an experiment file: what is searched, for what, and on which scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from armgpi.base.parameter import Parameter
from armgpi.config.schema import SECTIONS
from armgpi.config.section import (
    Key,
    Path_,
    Section,
    flag,
    key_of,
    listing,
    mapping,
    number,
    plain_number,
    text,
    word,
)


def _whole(default: Any, least: int, most: int, none: str = "") -> Key:
    """Return the key of a whole number."""
    return key_of(Parameter("", kind="integer", default=default, least=least, most=most, none=none))


class RangeSection(Section):
    """How a free parameter is searched: from `low` to `high`, one value for all joints or one `per_joint`."""

    keys: ClassVar[Mapping[str, Key]] = {
        "low": Key(plain_number, None, optional=True),
        "high": Key(plain_number, None, optional=True),
        "per_joint": Key(flag, False),
    }


def _free(value: Any, path: Path_) -> dict[str, Any]:
    """Read what is free: keys with their ranges, or a list of keys."""
    if isinstance(value, list) and all(isinstance(key, str) for key in value):
        value = dict.fromkeys(value)
    found: dict[str, Any] = mapping(RangeSection.read, optional=True)(value, path)
    return found


class TuneSection(Section):
    """What is searched.

    Attributes:
        controller: label or type of the controller; the first one when not given.
        free: keys of its section that are varied, each with its range; all that declare one when not given.
        objective: arithmetic on metrics, less is better.
        over: how it is taken over scenarios; cvar is the mean of the worst.
        share: how much of them are the worst, for cvar.
        constraints: bounds on metrics that hold in every scenario.
        against: metric that is bounded by each of the budgets, on average over the scenarios.
        budgets: bounds of that metric, for a front: one search for each, all in the same generations.
        method: what proposes candidates.
        evaluations: how many candidates are tried.
        population: candidates in a generation (of each budget); the method's own number when not given.
        seed: of the search.
        scenarios: draws to search on.
        held_out: draws that the search never sees, on which its result is judged.
    """

    keys: ClassVar[Mapping[str, Key]] = {
        "controller": Key(text, None, optional=True),
        "free": Key(_free, None, optional=True),
        "objective": Key(text, "itae"),
        "over": Key(word("mean", "median", "worst", "cvar"), "mean"),
        "share": key_of(Parameter("", default=0.1, least=0.0, most=1.0, above=True)),
        "constraints": Key(listing(text), []),
        "against": Key(text, "total_variation"),
        "budgets": Key(listing(number(Parameter("", least=0.0, above=True)), 1), None, optional=True),
        "method": Key(word("cma", "pso", "optuna"), "cma"),
        "evaluations": _whole(200, 2, 10_000_000),
        "population": _whole(None, 4, 100_000, none="the method's own"),
        "seed": _whole(0, 0, 2**63 - 1),
        "scenarios": _whole(8, 1, 4096),
        "held_out": _whole(16, 1, 4096),
    }


SECTIONS.update({"tune": TuneSection, "free": RangeSection})
