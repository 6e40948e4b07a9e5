"""Write the pages to play with of the paper's arm, UR5 and Panda into build/playground.

Usage:
    python tools/playground.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

from armgpi import config, play
from armgpi.viz import meshcat

#: Robot -> what its experiment is, beside the default move.
PAGES = {
    "anthropomorphic3": "robot: {name: anthropomorphic3}",
    "ur5": "robot: {name: ur5}",
    "panda": "robot: {name: panda, lock: [panda_finger_joint1, panda_finger_joint2]}",
}
REST = "\nplant: {encoder_bits: 16, delay: 1}\ncontrollers: [{type: network}]\nt_final: 8\n"


def main() -> None:
    """Write the pages."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "build" / "playground"
    folder.mkdir(parents=True, exist_ok=True)
    for name, robot in PAGES.items():
        experiment = config.build(*config.parse(robot + REST, name))
        print(
            "wrote",
            meshcat.write(play.build(experiment, title=f"{name}, to play with"), folder / f"{name}.html"),
        )


if __name__ == "__main__":
    main()
