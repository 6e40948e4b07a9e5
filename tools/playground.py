"""Write the pages to play with of the paper's arm, UR5 and Panda into build/playground.

With --measure: how long the pages that are there take from a slider's release to new curves, in headless
Chromium, beside the same run by Python's compiled back end.

Usage:
    python tools/playground.py [FOLDER] [--measure]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import armgpi
from armgpi import config
from armgpi.viewing import meshcat, play

#: Robot -> what its experiment is, beside the default move.
PAGES = {
    "anthropomorphic3": "robot: {name: anthropomorphic3}",
    "ur5": "robot: {name: ur5}",
    "panda": "robot: {name: panda, lock: [panda_finger_joint1, panda_finger_joint2]}",
}
REST = "\nplant: {encoder_bits: 16, delay: 1}\ncontrollers: [{type: network}]\nt_final: 8\n"


ROUNDS = 15
#: Moves a slider to a place, and returns the time until the curves are drawn anew [ms].
MOVED = """(async (place) => {
  const inputs = [...document.querySelectorAll("input")];
  const slider = inputs.find((x) => x.dataset.id === "controllers.0.omega.upper");
  const frame = () => new Promise(requestAnimationFrame);
  const before = armgpi.page.count, begun = performance.now();
  slider.value = place;
  slider.dispatchEvent(new Event("input"));
  while (armgpi.page.count === before) await frame();
  await frame();
  return performance.now() - begun;
})"""


def main() -> None:
    """Write the pages, or measure them."""
    words = [word for word in sys.argv[1:] if not word.startswith("--")]
    folder = Path(words[0]) if words else Path(__file__).parents[1] / "build" / "playground"
    if "--measure" in sys.argv:
        measure(folder)
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name, robot in PAGES.items():
        experiment = made(name, robot)
        print(
            "wrote",
            meshcat.write(play.build(experiment, title=f"{name}, to play with"), folder / f"{name}.html"),
        )


def made(name: str, robot: str) -> config.Experiment:
    """Return the experiment of a page."""
    return config.build(*config.parse(robot + REST, name))


def measure(folder: Path) -> None:
    """Print size, time to new curves, and that of the native run, of every page."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    import browser as browsers

    print("| page | size [MB] | slider to curves [ms] | native run [ms] | ratio |\n|---|---|---|---|---|")
    running = browsers.Browser((1280, 900))
    for name, robot in PAGES.items():
        path = folder / f"{name}.html"
        shown = running.open(path, "window.armgpi && (armgpi.ready || armgpi.error)")
        experiment = made(name, robot)
        (controller,) = experiment.controllers.values()
        parts = (experiment.plant, controller, experiment.reference, experiment.t_final)
        loop = armgpi.prepare(*parts, backend="compiled")
        loop.run({})
        pages, natives = [], []
        for k in range(ROUNDS):
            pages.append(shown.eval(f"({MOVED})({20 + k})"))
            begun = time.perf_counter()
            loop.run({})
            natives.append(1e3 * (time.perf_counter() - begun))
        page, native = float(np.median(pages)), float(np.median(natives))
        size = path.stat().st_size / 1e6
        # One frame of 60 Hz is the browser's own.
        print(f"| {name} | {size:.2g} | {page:.0f} | {native:.0f} | {(page - 1000 / 60) / native:.1f} |")
        assert not shown.errors
    running.close()


if __name__ == "__main__":
    main()
