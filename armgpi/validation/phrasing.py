"""What a factor or a number means: a unit, a square that is missing, one length for another."""

from __future__ import annotations

import numpy as np

from armgpi.validation.hypotheses import Names
from armgpi.validation.tree import Tree

#: Factors that stand for another unit or a slip, and what they mean.
_RATIOS = {
    1000.0: "1000 times: g for kg, or mm for m",
    0.001: "a thousandth: kg for g, or km for m",
    100.0: "100 times: cm for m",
    0.01: "a hundredth: as if in units of 100 m",
    1e6: "10⁶ times: kg mm² or g m mm for kg m²",
    1e4: "10⁴ times: kg cm² for kg m²",
    1e7: "10⁷ times: g cm² for kg m²",
    1e9: "10⁹ times: g mm² for kg m²",
    2.20462262: "pounds for kg",
    3.28083990: "feet for m",
    39.3700787: "inches for m",
    57.2957795: "degrees for radians",
    0.0174532925: "radians turned into radians once more (π/180)",
    2.0: "twice",
    0.5: "half",
    4.0: "four times: a diameter or a full length for half of it, squared",
    0.25: "a quarter: half of a length, squared",
    12.0: "12 times: the 1/12 of a rod is missing",
    1.0 / 12.0: "a twelfth",
    3.0: "three times: the 1/3 of a rod is missing",
    1.0 / 3.0: "a third, as of a rod about its end",
    9.81: "9.81 times: a weight for a mass",
    1.0 / 9.81: "1/9.81: a mass for a weight",
}


def ratio(factor: float) -> str:
    """Return what a factor usually means, in brackets; "" when it means nothing."""
    text = next((text for known, text in _RATIOS.items() if abs(factor / known - 1.0) < 1e-07), "")
    return f" ({text})" if text else ""


def known_numbers(tree: Tree) -> list[tuple[float, str]]:
    """Return masses, lengths, moments of inertia and gravity of an arm, without signs, and their names."""
    names = Names(tree)
    found = [(float(np.linalg.norm(tree.gravity)), "gravity")]
    for i, body in enumerate(tree.bodies):
        found.append((body.mass, f"the mass of {names.link(i)}"))
    for i, body in enumerate(tree.bodies):
        found += [(x, f"the inertia of {names.link(i)}") for x in np.abs(body.inertia).ravel().tolist()]
    return found + lengths(tree)


def lengths(tree: Tree) -> list[tuple[float, str]]:
    """Return lengths and distances of centres of mass, whole and along the axes, without zeros."""
    names = Names(tree)
    vectors = [(p, f"the length to {names.joint(i)}") for i, p in enumerate(tree.positions)]
    vectors.append((tree.tool_position, "the length to the tool"))
    vectors += [
        (b.com, f"the distance of the centre of mass of {names.link(i)}") for i, b in enumerate(tree.bodies)
    ]
    found = []
    for vector, name in vectors:
        # A length along an axis and its one component are the same number.
        parts = {round(float(x), 12) for x in (np.linalg.norm(vector), *np.abs(vector))}
        found += [(x, name) for x in sorted(parts, reverse=True) if x > 0.0]
    return found
