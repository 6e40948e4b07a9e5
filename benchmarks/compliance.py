"""Compliance: springs, force limits, walls, hands and rivals, on arms that nothing was tuned for.

python benchmarks/compliance.py [--quick] [--part NAME]
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import warnings

import _page
from _compliant import Part
from _cost import cost
from _energy import energy
from _force_stop import stops
from _pressing import causes, circles, hands, walls
from _springs import elastic, front, springs
from _task_rivals import rivals

import armgpi

#: Parts of the page in this order: name -> heading and what prints it.
PARTS: dict[str, tuple[str, Part]] = {
    "springs": ("Springs", springs),
    "elastic": ("Springs on elastic joints", elastic),
    "front": ("A stiff spring: circle against torque step", front),
    "walls": ("Force limit: walls", walls),
    "causes": ("Force limit: orientation and bounces", causes),
    "hands": ("Force limit: hands", hands),
    "circle": ("Force limit: the circle", circles),
    "stop": ("A stop by the estimated force", stops),
    "energy": ("Energy at the tool", energy),
    "rivals": ("Rivals", rivals),
    "cost": ("Cost", cost),
}


def main() -> None:
    """Print the page."""
    warnings.simplefilter("ignore", armgpi.ArmgpiWarning)
    world = "realistic rotors; joints, friction and encoders as each table names them"
    page = _page.begin(__file__, "Compliance", world, tuple(PARTS))
    for name, (heading, part) in PARTS.items():
        if page.part in ("", name):
            print(f"\n## {heading}", flush=True)
            part(page.quick)
    if not page.part:
        page.write()


if __name__ == "__main__":
    main()
