"""Draw the pictures of the README and the docs anew, into docs/images.

Usage: python tools/gallery.py [NAME]... (all of them by default; in an environment with the `all` and `dev`
extras, and with Chromium)
"""

from __future__ import annotations

import io
import math
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import browser as browsers  # noqa: E402
import numpy as np  # noqa: E402
import xarray as xr  # noqa: E402
from PIL import Image  # noqa: E402

import armgpi  # noqa: E402
from armgpi.studies import pictures  # noqa: E402
from armgpi.viewing import meshcat, plots, scene  # noqa: E402

IMAGES = ROOT / "docs" / "images"
#: Picture -> the experiment that it shows, in armgpi's words, and the time to show [s].
STILLS = {
    "laser": (["--config", "{folder}/laser.yaml"], 26.0),
    "panda": (["panda", *("--lock", "panda_finger_joint1"), "--payload", "0.5"], 1.6),
    "ur5": (["ur5", "--payload", "0.5"], 1.6),
    "kinova": (["kinova"], 1.6),
    "talos": (["talos_left_arm"], 1.6),
}
#: Picture -> the page whose code draws it, and into which file.
FIGURES = {"readme": ("README.md", "panda.png"), "tutorial": ("docs/tutorial.md", "ur5.png")}
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


#: The other pictures, by the words that ask for them.
OTHERS = ("moving", "figures", "report", "play", "tune", "contend")
#: The moving picture: begin, end and step of what is shown [s], and how long each image stays [ms].
MOVING, STAYS = (16.0, 28.0, 0.3), 90


def main() -> None:
    """Run the experiments, draw them, and take the stills."""
    IMAGES.mkdir(exist_ok=True)
    wanted = set(sys.argv[1:]) or {*STILLS, *FIGURES, *OTHERS}
    running = browsers.Browser((960, 640))
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "laser.yaml").write_text(LASER, encoding="utf-8")
            for picture, (words, at) in STILLS.items():
                of_laser = picture == "laser" and wanted & {"laser", "moving", "figures", "report"}
                if picture not in wanted and not of_laser:
                    continue
                made = _run([word.format(folder=folder) for word in words], folder / picture)
                page = meshcat.write(meshcat.rollout_page(armgpi.load(made)), folder / f"{picture}.html")
                if picture in wanted:
                    _still(running, page, at, IMAGES / f"{picture}.png")
            _plots(wanted, folder)
            if "moving" in wanted:
                _moving(running, folder / "laser.html", IMAGES / "laser.webp")
            if "figures" in wanted:
                _figures(armgpi.load(folder / "laser" / "rollout.nc"))
            if "play" in wanted:
                command = [sys.executable, "-m", "armgpi.cli", "play", "anthropomorphic3"]
                subprocess.run([*command, "-o", str(folder / "play.html")], check=True)
                _still(running, folder / "play.html", 1.6, IMAGES / "play.png", (1280, 800))
            if "report" in wanted:
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


def _plots(wanted: set[str], folder: Path) -> None:
    """Draw the figures of pages, and that of a search."""
    for picture, (text, figure) in FIGURES.items():
        if picture in wanted:
            _of_text(folder, text, figure, IMAGES / f"{picture}.png")
    if "contend" in wanted:
        _contest()
    if "tune" in wanted:
        command = [sys.executable, "-m", "armgpi.cli", "tune", str(ROOT / "examples" / "tune.yaml")]
        subprocess.run([*command, "--out", str(folder / "tuned")], check=True)
        shutil.copyfile(folder / "tuned" / "study.png", IMAGES / "tune.png")


def _contest() -> None:
    """Draw the fronts of the benchmark of controllers from the tables of its page (hours of runs)."""
    text = (ROOT / "docs" / "contest.md").read_text(encoding="utf-8")
    arms: dict[str, dict[str, dict[str, float]]] = {}
    groups: dict[str, list[str]] = {}
    for table in re.findall(r"^\| \w+: controller \(numbers\).*\n(?:\|.*\n)+", text, re.MULTILINE):
        head, _, *rows = [[cell.strip(" *") for cell in line.split("|")[1:-1]] for line in table.splitlines()]
        own = arms.setdefault(head[0].partition(":")[0], {})
        for name, *cells in rows:
            if not any(cells):
                laws = groups.setdefault(name, [])
                continue
            law = re.sub(r" \(\d+\)$", "", name)
            errors = [math.nan if cell == "-" else float(cell) for cell in cells[:-1]]
            own[law] = dict(zip(head[1:-1], errors, strict=True))
            laws += [] if law in laws else [law]
    shown = {name: laws for name, laws in groups.items() if len(laws) > 1}
    with Image.open(io.BytesIO(pictures.draw_contest(arms, shown))) as drawn:
        drawn.convert("RGB").quantize(64).save(IMAGES / "contend.png", optimize=True)
    print(f"wrote {IMAGES / 'contend.png'}")


def _of_text(folder: Path, text: str, figure: str, image: Path) -> None:
    """Run the first Python of a page, which draws a figure."""
    code = (ROOT / text).read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=folder)
    shutil.copyfile(folder / figure, image)
    print(f"wrote {image}")


def _moving(running: browsers.Browser, page: Path, image: Path) -> None:
    """Take a moving picture of a page."""
    shown = _opened(running, page, (960, 640))
    shown.eval("document.querySelectorAll('.dg').forEach(each => each.style.display = 'none')")
    images = []
    with tempfile.TemporaryDirectory() as name:
        for at in np.arange(*MOVING):
            shown.eval(f"armgpi.scene.show({at})")
            time.sleep(0.6)
            shown.screenshot(Path(name) / "image.png")
            with Image.open(Path(name) / "image.png") as each:
                images.append(each.convert("RGB").crop((0, 0, 960, 528)).resize((720, 396)))
    images[0].save(image, save_all=True, append_images=images[1:], duration=STAYS, loop=0, quality=60)
    print(f"wrote {image}")


def _opened(running: browsers.Browser, page: Path, size: tuple[int, int]) -> browsers.Page:
    """Open a page that does not play by itself."""
    shown = running.open(page, "window.armgpi && armgpi.scene")
    shown.size(*size)
    shown.eval("armgpi.player && armgpi.player.play(false)")
    time.sleep(1.5)  # until it is drawn finely
    return shown


def _still(
    running: browsers.Browser, page: Path, at: float, image: Path, size: tuple[int, int] = (960, 640)
) -> None:
    """Take a picture of a page at a time of its clip."""
    shown = _opened(running, page, size)
    shown.eval(f"armgpi.scene.show({at})")
    time.sleep(2.0)
    shown.screenshot(image)
    print(f"wrote {image}")


if __name__ == "__main__":
    main()
