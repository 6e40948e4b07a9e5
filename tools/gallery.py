"""Draw the pictures of the README and the docs anew, into docs/images.

Usage: python tools/gallery.py (in an environment with the `all` and `dev` extras, and with Chromium)
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import browser as browsers  # noqa: E402
import xarray as xr  # noqa: E402

import armgpi  # noqa: E402
from armgpi.viz import meshcat, plots, scene  # noqa: E402

IMAGES = ROOT / "docs" / "images"
#: Picture -> the experiment that it shows, in armgpi's words, and the time to show [s].
STILLS = {
    "laser": (["--config", "{folder}/laser.yaml"], 26.0),
    "panda": (["panda", *("--lock", "panda_finger_joint1"), "--payload", "0.5"], 1.6),
    "ur5": (["ur5", "--payload", "0.5"], 1.6),
    "kinova": (["kinova"], 1.6),
    "talos": (["talos_left_arm"], 1.6),
}
LASER = """\
robot: {name: anthropomorphic3}
reference: {path: {type: laser}}
plant:
  encoder_bits: 16
  loads: [{type: step, amplitude: [0.5, 1.0, 0.5], onset: 20}]
controllers:
  - {type: gpi, label: fixed gains, omega: 25}
  - {type: network, label: network}
t_final: 40
"""


def main() -> None:
    """Run the experiments, draw them, and take the stills."""
    IMAGES.mkdir(exist_ok=True)
    running = browsers.Browser((960, 640))
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "laser.yaml").write_text(LASER, encoding="utf-8")
            for picture, (words, at) in STILLS.items():
                made = _run([word.format(folder=folder) for word in words], folder / picture)
                page = meshcat.write(meshcat.rollout_page(armgpi.load(made)), folder / f"{picture}.html")
                _still(running, page, at, IMAGES / f"{picture}.png")
            rollout = armgpi.load(folder / "laser" / "rollout.nc")
            _figures(rollout)
            command = [sys.executable, "-m", "armgpi.cli", "report", str(folder / "laser" / "rollout.nc")]
            subprocess.run([*command, "-o", str(folder / "report.html")], check=True)
            _still(running, folder / "report.html", 21.0, IMAGES / "report.png", (1280, 900))
    finally:
        running.close()


def _run(words: list[str], out: Path) -> Path:
    """Run an experiment and return its rollout."""
    verb = "compare" if "--config" in words else "run"
    done = subprocess.run([sys.executable, "-m", "armgpi.cli", verb, *words, "--out", str(out)], check=False)
    assert done.returncode in (0, 1)
    return out / "rollout.nc"


def _figures(rollout: xr.Dataset) -> None:
    """Draw the figures of the laser path."""
    robot = scene.robot_of(rollout)
    plots.save(plots.overview(rollout), IMAGES / "overview.png")
    plots.save(plots.tool_path(rollout, robot), IMAGES / "tool_path.png")


def _still(
    running: browsers.Browser, page: Path, at: float, image: Path, size: tuple[int, int] = (960, 640)
) -> None:
    """Take a picture of a page at a time of its clip."""
    shown = running.open(page, "window.armgpi && armgpi.scene")
    shown.size(*size)
    shown.eval("armgpi.player && armgpi.player.play(false)")
    time.sleep(1.5)  # until it is drawn finely
    shown.eval(f"armgpi.scene.show({at})")
    time.sleep(2.0)
    shown.screenshot(image)
    print(f"wrote {image}")


if __name__ == "__main__":
    main()
