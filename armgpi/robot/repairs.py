"""Repairs of a URDF: for what is written wrongly and can mean one thing alone.

Such a file is refused, and the refusal names the repair. It is made only when it is asked for, by its name
``KIND:ELEMENT``, by its kind, or by ``"all"``, and a robot's provenance keeps what was there before.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

from armgpi.base import renamed
from armgpi.base.renamed import current_name
from armgpi.errors import NameNotFound, ParameterError, Remedy, UrdfError

ALL = "all"
#: The repair that is no correction but a start.
SUPPOSE = "assume-bodies"
#: Kinds that are no corrections either: they take what no arm has.
ACCEPT, NO_FRICTION = "accept-inertia", "no-friction"
#: The repair of an inertia that is about the link's origin.
ABOUT_CENTRE = "about-centre"
#: The repair of products of inertia with the sign that some CAD programs give.
PRODUCTS = "products-sign"


class UnitRepair(NamedTuple):
    """Another unit, or point, of a link's mass properties, and the factors that make them SI.

    Attributes:
        meaning: what the file has.
        mass, inertia, centre: factors.
        products: factor of the products of inertia alone.
    """

    meaning: str
    mass: float = 1.0
    inertia: float = 1.0
    centre: float = 1.0
    products: float = 1.0


#: Kind of a repair -> the unit that it takes the file's numbers for; none of them is part of `all`.
UNITS = {
    "grams": UnitRepair("masses are in g", mass=1e-3),
    "inertia-g": UnitRepair("inertias are in g m^2", inertia=1e-3),
    "inertia-mm": UnitRepair("inertias are in kg mm^2", inertia=1e-6),
    "inertia-g-mm": UnitRepair("inertias are in g mm^2", inertia=1e-9),
    "centre-mm": UnitRepair("centres of mass are in mm", centre=1e-3),
    PRODUCTS: UnitRepair(
        "products of inertia are sums of x y, without the minus sign of URDF", products=-1.0
    ),
    ABOUT_CENTRE: UnitRepair("inertias are about the link's origin, not the centre of mass"),
}
#: Kind -> what the repair does.
KINDS = {
    ACCEPT: "an inertia that no rigid body has, of an identified set, is taken as it is; not part of all",
    **{kind: f"{unit.meaning}; not part of all" for kind, unit in UNITS.items()},
    "drop-inertia": "a moving link with an inertia and the mass 0 becomes a frame, without inertia",
    "mirror-inertia": "an inertia whose lower triangle alone is written (iyx, izx, izy) is symmetric",
    NO_FRICTION: "a negative damping or friction, of an identified set, is taken as 0; not part of all",
    "reorder-inertia": "an inertia that is positive in one other order of its numbers alone is read so",
    SUPPOSE: ("an arm without any mass gets assumed bodies, which have to be identified; not part of all"),
    "split-commas": "commas between the numbers of one attribute are read as separators",
}


class Repair(NamedTuple):
    """A repair that was made.

    Attributes:
        name: its kind and the link or joint, as in "drop-inertia:flange".
        before: what the file says.
        after: what was taken instead.
    """

    name: str
    before: str
    after: str


def repair_names(names: str | Iterable[str]) -> frozenset[str]:
    """Return the names of repairs given as several, or in one text with commas between them.

    Raises:
        ParameterError: when they are no names.
        NameNotFound: for a kind of repair that does not exist.
    """
    try:
        given = names.split(",") if isinstance(names, str) else list(names)
        asked = frozenset(name.strip() for name in given if name.strip())
    except (TypeError, AttributeError):
        raise ParameterError("repair", names, "names of repairs, or 'all'") from None
    asked = frozenset(map(_current, asked))
    for name in asked:
        if name.partition(":")[0] not in KINDS and name != ALL:
            raise NameNotFound("repair", name, (*KINDS, ALL))
    return asked


def _current(name: str) -> str:
    """Return the name of a repair with its current kind."""
    kind, *rest = name.split(":", 1)
    return ":".join([current_name(kind, renamed.REPAIRS, 4), *rest])


def made_in(provenance: Mapping[str, Any]) -> list[str]:
    """Return the names of the repairs that a robot's provenance records, to load it in the same way."""
    return [str(made["name"]) for made in provenance.get("repairs", ())]


class Repairs:
    """What may be repaired in one URDF, and what was.

    Attributes:
        source: the file, for messages.
        wanted: names of the repairs that were asked for.
        made: the repairs that were made, in order.
    """

    def __init__(self, source: str, wanted: frozenset[str], made: Iterable[Repair] = ()) -> None:
        """Allow the `wanted` repairs."""
        self.source = source
        self.wanted = wanted
        self.made = list(made)

    def wants(self, kind: str, element: str) -> bool:
        """Tell whether a repair was asked for; `all` means corrections alone."""
        asked = {kind, f"{kind}:{element}"} | (set() if kind in (ACCEPT, NO_FRICTION, *UNITS) else {ALL})
        return bool(self.wanted & asked)

    def make(self, kind: str, element: str, problem: str, before: str, after: str) -> None:
        """Record a repair that was asked for.

        Raises:
            UrdfError: with the `problem` and the name of the repair, when it was not.
        """
        name = f"{kind}:{element}"
        if not self.wants(kind, element):
            error = UrdfError(
                self.source, f"{problem}; correct the file, or load it with repair={name!r}", element
            )
            raise error.suggesting(Remedy("repair", (), name))
        self.made.append(Repair(name, before, after))

    def check_names(self, elements: Collection[str]) -> None:
        """Refuse a repair of a link or joint that does not exist."""
        for name in sorted(self.wanted):
            _, colon, element = name.partition(":")
            if colon and element not in elements:
                raise NameNotFound("link or joint to repair", element, elements)
