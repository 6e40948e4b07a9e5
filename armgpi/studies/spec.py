"""The section `tune` of an experiment file: what is searched, for what, and on which scenarios."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from armgpi.config.schema import SECTIONS, Number, Positive, Section, Whole


def _as_mapping(value: Any) -> Any:
    """Accept a list of keys in place of a mapping."""
    return (
        dict.fromkeys(value) if isinstance(value, list) and all(isinstance(k, str) for k in value) else value
    )


class RangeSection(Section):
    """How a free parameter is searched: from `low` to `high`, one value for all joints or one `per_joint`."""

    low: Number | None = None
    high: Number | None = None
    per_joint: bool = False


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

    controller: str | None = None
    free: Annotated[dict[str, RangeSection | None], BeforeValidator(_as_mapping)] | None = None
    objective: str = "itae"
    over: Literal["mean", "median", "worst", "cvar"] = "mean"
    share: Annotated[Number, Field(gt=0.0, le=1.0)] = 0.1
    constraints: list[str] = Field(default=[])
    against: str = "total_variation"
    budgets: list[Positive] | None = Field(default=None, min_length=1)
    method: Literal["cma", "pso", "optuna"] = "cma"
    evaluations: Annotated[Whole, Field(ge=2, le=10_000_000)] = 200
    population: Annotated[Whole, Field(ge=4, le=100_000)] | None = None
    seed: Annotated[Whole, Field(ge=0, le=2**63 - 1)] = 0
    scenarios: Annotated[Whole, Field(ge=1, le=4096)] = 8
    held_out: Annotated[Whole, Field(ge=1, le=4096)] = 16


SECTIONS.update({"tune": TuneSection, "free": RangeSection})
