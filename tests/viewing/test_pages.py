"""The pages in a browser: the arm is where Pinocchio puts it, controls work, nothing is asked of the network.

Skipped where no Chromium is installed; CI installs one.
"""

from __future__ import annotations

import base64
import contextlib
import gzip
import io
import json
import re
from collections.abc import Callable, Iterator
from functools import partial
from importlib import resources
from pathlib import Path

import browser as browsers
import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from pictured import HOSTILE, box_mesh, chain, compared, made_up, package, run
from PIL import Image
from sampling import for_search

import armgpi
from armgpi import GPI, Hold, RigidBodyPlant, Robot, robots, simulate
from armgpi.errors import RolloutError
from armgpi.viewing import meshcat, page, plots, report, scene, style, tracks

ARM = Robot.load("anthropomorphic3")
#: How many lines the plots of a report have.
DRAWN = "armgpi.plots.cells.reduce((sum, cell) => sum + cell.lines(100).length, 0)"
READY = "window.armgpi && (armgpi.ready || armgpi.error)"
#: Where all bodies of an arm are in the scene, column by column. MeshCat turns the scene as a whole: z is up.
POSES = """(robot) => armgpi.scene.robots[robot].nodes.map((node) => {
    node.object.updateWorldMatrix(true, false);
    const upright = armgpi.scene.viewer.scene.matrixWorld.clone().invert();
    return node.object.matrixWorld.clone().premultiply(upright).elements;
})"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[browsers.Browser]:
    if browsers.program() is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(browsers.PROGRAMS)})")
    running = browsers.Browser()
    yield running
    running.close()


def opened(chromium: browsers.Browser, html: str, folder: Path) -> browsers.Page:
    """Open a page from a file; it must have no error."""
    shown = chromium.open(meshcat.write(html, folder / "page.html"), READY)
    assert shown.eval("armgpi.error") is None
    return shown


def quiet(shown: browsers.Page) -> None:
    """The page had no error and asked for nothing but itself."""
    assert shown.errors == []
    outside = [url for url in shown.requests if not url.startswith(("file://", "data:", "blob:"))]
    assert outside == []
    assert len([url for url in shown.requests if url.startswith("file://")]) == 1


def still(robot: Robot) -> xr.Dataset:
    """A rollout in which nothing moves."""
    reference = Hold(robot.middle() + 0.2)
    return simulate(RigidBodyPlant(robot), GPI(robot, dt=1e-3), reference, t_final=0.1)


def moving(robot: Robot) -> xr.Dataset:
    return run(robot, t_final=0.3)


CASES: dict[str, tuple[Callable[[], Robot], Callable[[Robot], xr.Dataset]]] = {
    "the paper's arm": (lambda: ARM, moving),
    "an arm that stands still": (lambda: ARM, still),
    "a slide among hinges": (lambda: chain(5, 3.0), moving),
    "a small one": (lambda: chain(2, 0.3), moving),
    "fourteen joints": (lambda: chain(14, 2.0), made_up),
    **{name: (partial(Robot.load, name), moving) for name in ("ur5", "kinova") if name in robots.names()},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", [for_search(x) if x == "kinova" else x for x in CASES])
def test_links_are_where_pinocchio_puts_them(case: str, chromium: browsers.Browser, tmp_path: Path) -> None:
    load, make = CASES[case]
    robot = load()
    rollout = make(robot)
    shown = opened(chromium, meshcat.rollout_page(rollout, robot), tmp_path)
    shown.eval("armgpi.player.play(false)")
    model = robot.pinocchio_model()
    data = model.createData()
    time = rollout["time"].values
    for at in (0, len(time) // 3, len(time) - 1):
        # Between two frames of the clip too: time is what the page is asked for.
        found = shown.eval(f"(armgpi.scene.show({time[at]}), ({POSES})(0))")
        pin.forwardKinematics(model, data, rollout["q"].values[at])
        for elements, expected in zip(found, data.oMi, strict=True):
            pose = np.array(elements).reshape(4, 4).T
            assert np.linalg.norm(pose[:3, 3] - expected.translation) < 1e-3
            turned = pose[:3, :3].T @ expected.rotation
            assert np.arccos(np.clip(0.5 * (np.trace(turned) - 1.0), -1.0, 1.0)) < 5e-3
        tip = np.array(shown.eval("armgpi.scene.robots[0].bead.position.toArray()"))
        there = robot.frame_pose(robot.tip, rollout["q"].values[at]).translation
        assert np.linalg.norm(tip - there) < 1e-3
    quiet(shown)


def picture(shown: browsers.Page) -> np.ndarray:
    """The scene as pixels."""
    return pixels(shown.eval("armgpi.scene.picture()"))


def pixels(uri: str) -> np.ndarray:
    """A picture as pixels."""
    image = Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))).convert("RGB")
    return np.asarray(image, dtype=int)


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_the_arm_is_in_sight_whatever_its_size(
    size: float, chromium: browsers.Browser, tmp_path: Path
) -> None:
    robot = chain(3, size)
    shown = opened(chromium, meshcat.rollout_page(moving(robot), robot), tmp_path)
    shown.eval("armgpi.player.play(false)")
    full = picture(shown)
    for what in ("robots", "ghosts", "paths", "rings"):
        shown.eval(f"armgpi.scene.toggle('{what}', false)")
    empty = picture(shown)
    differs = np.abs(full - empty).max(axis=2) > 8
    rows, columns = np.nonzero(differs)
    assert differs.mean() > 0.002
    # In the middle of the picture, and large in it.
    height, width = differs.shape
    assert 0.3 * height < rows.max() - rows.min() < height - 2 or columns.max() - columns.min() > 0.3 * width
    inside = rows.min() > 0, rows.max() < height - 1, columns.min() > 0, columns.max() < width - 1
    assert all(inside)


#: Two frames that come late, and then the picture.
LATE = """() => {
    const { scene } = armgpi, begin = performance.now();
    scene.viewer.render();
    while (performance.now() < begin + 200);
    scene.viewer.render();
    return [scene.coarse, scene.picture()];
}"""


def test_a_picture_is_fine_where_frames_come_late(chromium: browsers.Browser, tmp_path: Path) -> None:
    shown = opened(chromium, meshcat.rollout_page(moving(ARM), ARM), tmp_path)
    shown.eval("armgpi.player.play(false)")
    size = picture(shown).shape
    coarse, uri = shown.eval(f"({LATE})()")
    assert coarse
    assert pixels(uri).shape == size


#: How far from the middle of the picture a corner of a body is at a time; 1 is at the picture's edge.
FARTHEST = """(time) => {
    const { scene } = armgpi, T = scene.THREE;
    scene.show(time);
    scene.viewer.camera.updateWorldMatrix(true, false);
    const corners = scene.robots[0].nodes.flatMap((node, i) => {
        node.object.updateWorldMatrix(true, false);
        const { min, max } = scene.geometry(i, "coarse").boundingBox;
        return [0, 1, 2, 3, 4, 5, 6, 7].map((k) =>
            new T.Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z)
                .applyMatrix4(node.object.matrixWorld).project(scene.viewer.camera));
    });
    return Math.max(...corners.flatMap((at) => [Math.abs(at.x), Math.abs(at.y)]));
}"""


def test_all_that_an_arm_does_is_in_sight(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = moving(ARM).copy(deep=True)
    share = np.linspace(0.0, 1.0, rollout.sizes["time"])[:, np.newaxis]
    rollout["q"].values = share * np.array([0.5, 1.5, 0.0])  # from lying to standing
    # The tool hardly moves: its path alone does not say how much room the arm takes.
    html = meshcat.rollout_page(rollout, ARM, frame=ARM.joint_names[0])
    shown = opened(chromium, html, tmp_path)
    shown.eval("armgpi.player.play(false)")
    for view in ("iso", "front", "side", "top"):
        shown.eval(f"armgpi.scene.look_from('{view}')")
        farthest = [shown.eval(f"({FARTHEST})({time})") for time in rollout["time"].values[[0, 7, -1]]]
        assert 0.3 < max(farthest) <= 1.0


def test_a_ghost_stands_at_the_reference(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = moving(ARM).copy(deep=True)
    rollout["q_ref"].values += 0.3
    shown = opened(chromium, meshcat.rollout_page(rollout, ARM), tmp_path)
    shown.eval("armgpi.player.play(false); armgpi.scene.show(0.2)")
    ghost = POSES.replace("robots[robot]", "ghosts[robot]")
    found = np.array(shown.eval(f"({ghost})(0)"))[-1].reshape(4, 4).T
    expected = ARM.frame_pose(ARM.joint_names[-1], rollout["q_ref"].sel(time=0.2, method="nearest").values)
    assert np.allclose(found[:3, 3], expected.translation, atol=1e-3)
    assert shown.eval("armgpi.scene.ghosts[0].root.object.visible")
    shown.eval("armgpi.scene.toggle('ghosts', false)")
    assert not shown.eval("armgpi.scene.ghosts[0].root.object.visible")


def test_errors_are_exaggerated_on_request(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = moving(ARM)
    shown = opened(chromium, meshcat.rollout_page(rollout, ARM), tmp_path)
    shown.eval("armgpi.player.play(false); armgpi.scene.exaggerate(10); armgpi.scene.show(0.15)")
    at = rollout.sel(time=0.15, method="nearest")
    q = at["q_ref"].values + 10.0 * (at["q"] - at["q_ref"]).values
    tip = np.array(shown.eval("armgpi.scene.robots[0].bead.position.toArray()"))
    assert np.allclose(tip, ARM.frame_pose(ARM.tip, q).translation, atol=1e-3)


def test_a_comparison_has_the_legend_s_colours(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = compared(soft=moving(ARM), stiff=run(ARM, omega=40.0))
    shown = opened(chromium, meshcat.rollout_page(rollout, ARM), tmp_path)
    colors = shown.eval("armgpi.scene.robots.map((r) => r.meshes[1].material.color.getHexString())")
    expected = [trace.look.color[1:].lower() for trace in tracks.traces(rollout)]
    assert colors == expected == [color[1:].lower() for color in style.PALETTE[:2]]
    assert shown.eval("document.querySelector('.gauges thead').textContent").count("finished") == 2
    quiet(shown)


def test_saturation_and_disturbance_are_marked(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = moving(ARM).copy(deep=True)
    rollout["tau"].values[150:200, 1] = rollout["effort"].values[1]
    shown = opened(chromium, meshcat.rollout_page(rollout, ARM), tmp_path)
    shown.eval("armgpi.player.play(false)")
    table = "[...document.querySelectorAll('.gauges tbody tr')].map((row) => row.textContent)"
    shown.eval("armgpi.scene.show(0.05)")
    assert not any("limit" in row or "external" in row for row in shown.eval(table))
    shown.eval("armgpi.scene.show(0.17)")
    rows = shown.eval(table)
    assert "at its limit" in rows[1]
    assert all("external" in row for row in (rows[0], rows[2]))
    assert shown.eval("armgpi.scene.robots[0].rings[2].scale.x") > 1.0
    assert shown.eval("document.querySelectorAll('.onsets span').length") == 3


def test_playing_stepping_and_keys(chromium: browsers.Browser, tmp_path: Path) -> None:
    shown = opened(chromium, meshcat.rollout_page(run(ARM, t_final=2.0), ARM), tmp_path)
    time = "armgpi.scene.time"
    shown.eval("armgpi.player.play(false); armgpi.scene.show(0)")
    frame = shown.eval("armgpi.scene.clip.times[1]")
    shown.key("ArrowRight")
    assert shown.eval(time) == pytest.approx(frame)
    shown.key("ArrowLeft")
    assert shown.eval(time) == 0.0
    shown.key("End")
    assert shown.eval(time) == pytest.approx(2.0)
    shown.key("Home")
    shown.key("+")
    assert shown.eval("armgpi.player.speed") == 2
    shown.key("-")
    shown.key("-")
    assert shown.eval("armgpi.player.speed") == 0.5
    shown.key(" ", "Space", " ")
    shown.wait(f"{time} > 0.05")
    shown.key(" ", "Space", " ")
    before = shown.eval(time)
    assert not shown.eval("armgpi.player.playing")
    assert shown.eval(time) == before
    shown.eval("armgpi.player.speed = 10; armgpi.player.play(true)")
    shown.wait("!armgpi.player.playing")  # it stops at the end by itself
    assert shown.eval(time) == pytest.approx(2.0)
    quiet(shown)


def test_a_robot_has_a_slider_for_every_joint(chromium: browsers.Browser, tmp_path: Path) -> None:
    robot = chain(4)
    shown = opened(chromium, meshcat.robot_page(robot), tmp_path)
    assert shown.eval("document.querySelectorAll('#sliders input').length") == 4
    shown.eval("""(() => { const slider = document.querySelectorAll('#sliders input')[2];
        slider.value = 0.7; slider.dispatchEvent(new Event('input')); })()""")
    found = np.array(shown.eval(f"({POSES})(0)")[-1]).reshape(4, 4).T
    q = robot.middle()
    q[2] = 0.7
    assert np.allclose(found[:3, 3], robot.frame_pose(robot.joint_names[-1], q).translation, atol=1e-5)
    quiet(shown)


# The report.


@pytest.mark.slow
def test_the_report_draws_and_its_controls_work(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = compared(soft=moving(ARM), stiff=run(ARM, omega=40.0))
    shown = opened(chromium, report.build(rollout, ARM, configuration="robot: {name: mine}"), tmp_path)
    lines = DRAWN
    # Position: two and the reference; error: two; velocity: two and the reference; torque and its rate: two
    # each; disturbance: one. Of three joints. Error and angle of the tool: two each.
    assert shown.eval(lines) == 3 * (3 + 2 + 3 + 2 + 2 + 1) + 4
    joint = "document.querySelectorAll('#choices fieldset')[1].querySelectorAll('input')[0]"
    shown.eval(f"{joint}.click()")
    shown.wait(f"{lines} === {2 * 13 + 4}")
    rollouts = "document.querySelectorAll('#choices fieldset')[0].querySelectorAll('input')[1]"
    shown.eval(f"{rollouts}.click()")
    shown.wait(f"{lines} === {2 * 8 + 2}")
    shown.eval(f"{joint}.focus()")  # and by keyboard
    shown.key(" ", "Space", " ")
    shown.wait(f"{lines} === {3 * 8 + 2}")
    # One time for the scene and the plots.
    shown.eval("armgpi.scene.show(0.15)")
    place = "parseFloat(document.querySelector('.cursor').style.left)"
    middle = shown.eval(place)
    left, right = 46, 4  # of a canvas, beside its curve
    width = shown.eval("armgpi.plots.cells[0].canvas.clientWidth")
    assert middle == pytest.approx(left + (width - left - right) / 2, abs=2.0)
    shown.eval("armgpi.plots.seek(0.3)")
    assert shown.eval("armgpi.scene.time") == pytest.approx(0.3)
    # What stands beside a cursor is the rollout's: here of the error of the first joint.
    said = shown.eval("armgpi.plots.cells[5].said.textContent").split(" | ")
    errors = armgpi.metrics.error(rollout).isel(joint=0, rollout=[0]).sel(time=0.3, method="nearest").values
    assert [float(text) for text in said] == pytest.approx(list(errors), rel=1e-2)
    # Zoom: all plots show the same stretch, and of its lines only that.
    shown.eval("document.querySelector('#zoom button').click()")
    assert shown.eval("armgpi.plots.range[0]") > 0.1
    places = shown.eval("armgpi.plots.cells.flatMap((c) => c.lines(100).flatMap((l) => [...l.places]))")
    assert -20 < min(places) < 1
    assert 99 < max(places) < 120
    assert "mine" in shown.eval("document.body.textContent")
    quiet(shown)


@pytest.mark.slow
def test_forces_are_arrows_where_they_act_and_walls_are_drawn(
    chromium: browsers.Browser, tmp_path: Path
) -> None:
    tip = ARM.frame_pose(ARM.tip, ARM.middle()).translation
    push = armgpi.ToolForce(force=[0.0, 0.3, 0.4], onset=0.1, end=0.2)
    wall = armgpi.Wall(normal=[0.0, 0.0, 2.0], distance=float(tip[2]) - 0.05)
    plant = armgpi.RigidBodyPlant(ARM, environment=[push, wall])
    rollout = armgpi.simulate(plant, armgpi.GPI(ARM, dt=1e-3), armgpi.Hold(ARM.middle()), 0.3)
    shown = opened(chromium, report.build(rollout, ARM), tmp_path)
    pushing = "armgpi.scene.arrows[0].map((arrow) => arrow.visible)"
    for time, visible in ((0.05, False), (0.15, True), (0.25, False)):
        shown.eval(f"armgpi.scene.show({time})")
        assert shown.eval(pushing) == [visible, False]
    shown.eval("armgpi.scene.show(0.15)")
    at = rollout["tool"].sel(time=0.15, method="nearest").values
    there = shown.eval("armgpi.scene.arrows[0][0].position.toArray()")
    assert there == pytest.approx(list(at), abs=2e-3)
    walls = shown.eval("armgpi.scene.clip.walls")
    assert [(x["normal"], x["contact"]) for x in walls] == [([0.0, 0.0, 1.0], 1)]
    assert walls[0]["distance"] == pytest.approx(tip[2] - 0.05)
    quiet(shown)


@pytest.mark.slow
def test_the_data_of_the_report_are_the_rollout(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = moving(ARM)
    html = report.build(rollout, ARM)
    (content,) = re.findall(r'<script id="armgpi-file" type="text/plain">([^<]*)</script>', html)
    (tmp_path / "got.nc").write_bytes(base64.b64decode(content))
    xr.testing.assert_identical(
        armgpi.load(tmp_path / "got.nc"), armgpi.load(armgpi.save(rollout, tmp_path / "a.nc"))
    )
    shown = opened(chromium, html, tmp_path)
    shown.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path / "down"))
    shown.eval("document.getElementById('download').click()")
    for _ in range(100):
        shown.eval("new Promise((done) => setTimeout(done, 50))")
        if (tmp_path / "down" / "rollout.nc").is_file():
            break
    assert (tmp_path / "down" / "rollout.nc").read_bytes() == (tmp_path / "got.nc").read_bytes()


def test_the_report_s_table_is_that_of_the_metrics() -> None:
    rollout = moving(ARM)
    html = report.build(rollout, ARM)
    for value in armgpi.metrics.itae(rollout).values:
        assert f"<td>{value:.4g}</td>" in html


def test_a_table_shows_its_cells_to_the_letter() -> None:
    head, rows = ("name", "error\nrad", "text"), [("<b>'", "1", "a & b"), ("y", "-", "")]
    html = page.table(head, rows, label="t", classes=("bad", ""), words=(2,))
    assert html.count("<tr") == 3
    assert "<th scope=col>error<br>rad</th>" in html
    assert "<tr class=bad><th scope=row class=name title='&lt;b&gt;&#x27;'>&lt;b&gt;&#x27;</th>" in html
    assert "<td>1</td><td class=words>a &amp; b</td></tr>" in html
    assert page.bullets([]) == ""
    assert page.bullets(["<"], "findings") == "<ul class=findings><li>&lt;</li></ul>"


def test_the_report_says_what_inspect_finds() -> None:
    html = report.build(moving(ARM), ARM)
    found = armgpi.health.inspect("anthropomorphic3").findings
    assert found
    for finding in found:
        assert page.text(finding) in html


def test_the_report_inspects_the_robot_that_ran_and_names_the_unit_of_the_worst_joint(tmp_path: Path) -> None:
    text = robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8")
    text = re.sub('effort="[^"]*"', 'effort="0"', text).replace(
        'name="q2" type="revolute"', 'name="q2" type="prismatic"'
    )
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    robot = armgpi.Robot.load(tmp_path / "arm.urdf").with_limits(effort=300.0)
    rollout = moving(robot)
    rollout["q"] = rollout["q"] + np.array([0.0, 0.9, 0.0])
    html = report.build(rollout, robot)
    assert "has effort limit 0" not in html
    assert re.search(r"error at most [\d.]+ m \(q2\)", html)


def test_data_are_thinned_to_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "DATA_BYTES", 80_000)
    html = report.build(run(ARM, t_final=2.0), ARM)
    assert re.search(r"One sample in \d+,", html)
    (content,) = re.findall(r'<script id="armgpi-file" type="text/plain">([^<]*)</script>', html)
    assert len(base64.b64decode(content)) <= 80_000


def test_thinned_lines_keep_their_extremes() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(50_000) * 1e-3
    values = rng.normal(size=time.size)
    values[[7, 41_234]] = 50.0, -50.0
    x, y = report._thin_line(time, values)
    assert len(x) <= report.POINTS + 2
    assert (y.max(), y.min()) == (50.0, -50.0)
    assert set(zip(x, y, strict=True)) <= set(zip(time, values, strict=True))
    assert (np.diff(x) > 0).all()
    # The same, stretch by stretch; of equal extremes the first one.
    values = np.round(values, 1)
    kept = {0, len(time) - 1}
    for stretch in np.split(
        np.arange(time.size), np.linspace(0, time.size, report.POINTS // 2 + 1).astype(int)[1:-1]
    ):
        kept |= {int(stretch[np.argmin(values[stretch])]), int(stretch[np.argmax(values[stretch])])}
    x, y = report._thin_line(time, values)
    assert np.array_equal(x, time[sorted(kept)])
    assert np.array_equal(y, values[sorted(kept)])


@pytest.mark.slow
def test_a_report_without_its_robot_says_so(chromium: browsers.Browser, tmp_path: Path) -> None:
    rollout = moving(chain(3))  # from text: there is no file to load again
    shown = opened(chromium, report.build(rollout), tmp_path)
    text = shown.eval("document.body.innerText")
    assert "was not found" in text
    assert shown.eval(DRAWN) > 0
    quiet(shown)


@pytest.mark.slow
def test_a_browser_without_3d_still_shows_plots(tmp_path: Path, chromium: browsers.Browser) -> None:
    html = report.build(moving(ARM), ARM)
    broken = html.replace("<head>", "<head>", 1)
    file = meshcat.write(broken, tmp_path / "page.html")
    shown = chromium.open("about:blank#", "true")
    shown.call(
        "Page.addScriptToEvaluateOnNewDocument", source="HTMLCanvasElement.prototype.getContext = () => null;"
    )
    shown.call("Page.navigate", url=file.as_uri())
    shown.wait("window.armgpi && armgpi.error")
    assert "animation cannot be shown" in shown.eval("document.body.innerText")
    assert shown.eval(DRAWN) > 0


def test_reports_of_several_files_have_all_rollouts() -> None:
    one, two = moving(ARM), run(ARM, omega=40.0)
    both = report.merge_rollouts({"a": one, "b": compared(soft=one, stiff=two)})
    assert list(both["label"].values) == ["a", "b: soft", "b: stiff"]
    assert np.array_equal(both["q"].isel(rollout=2), two["q"])
    with pytest.raises(RolloutError, match="joints"):
        report.merge_rollouts({"a": one, "b": made_up(chain(2))})
    with pytest.raises(RolloutError, match="no samples"):
        report.build(one.isel(time=slice(0)), ARM)


def test_the_same_rollout_makes_the_same_page() -> None:
    rollout = moving(ARM)
    assert meshcat.rollout_page(rollout, ARM) == meshcat.rollout_page(rollout, ARM)


# What files say never becomes part of the page.


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["robot", "rollout", "report"])
def test_hostile_names_are_text(kind: str, chromium: browsers.Browser, tmp_path: Path) -> None:
    joints, links = list(HOSTILE[:3]), [*HOSTILE[:3], "'\"--><svg onload=alert(1)>"]
    robot = chain(3, joints=joints, links=links)
    rollout = compared(**{HOSTILE[1]: moving(robot), "<b>bold</b>": moving(robot)})
    rollout.attrs["robot"] = "<script>parent.alert(2)</script>"
    html = {
        "robot": lambda: meshcat.robot_page(robot),
        "rollout": lambda: meshcat.rollout_page(rollout, robot),
        "report": lambda: report.build(rollout, robot, title=HOSTILE[1], configuration=HOSTILE[1]),
    }[kind]()
    shown = opened(chromium, html, tmp_path)
    assert shown.eval("document.querySelectorAll('img[src=x], [onload], [onerror]').length") == 0
    assert HOSTILE[1] in shown.eval("document.body.textContent")
    quiet(shown)


def test_bad_meshes_are_named_in_the_page(chromium: browsers.Browser, tmp_path: Path) -> None:
    urdf = package(tmp_path, good_stl=box_mesh("stl"), empty_stl=b"")
    shown = opened(chromium, meshcat.robot_page(Robot.load(urdf)), tmp_path)
    (finding,) = shown.eval("[...document.querySelectorAll('.findings li')].map((li) => li.textContent)")
    assert "empty.stl" in finding
    quiet(shown)


def test_a_page_may_not_fetch_anything(chromium: browsers.Browser, tmp_path: Path) -> None:
    shown = opened(chromium, meshcat.robot_page(ARM), tmp_path)
    blocked = """fetch('http://127.0.0.1:9/').then(() => 'fetched', () => 'blocked')"""
    assert shown.eval(blocked) == "blocked"
    assert any("Content Security Policy" in error for error in shown.errors)
    assert not any("127.0.0.1:9" in url for url in shown.requests)


def test_no_text_ends_the_element_it_stands_in() -> None:
    data = {"a": "</script><!-- & \u2028", "b": HOSTILE}
    text = page.json_text(data)
    assert not set("<>&") & set(text)
    # What no reader could see is written out; all else arrives as it is.
    assert json.loads(text) == {"a": "</script><!-- & \\u2028", "b": json.loads(json.dumps(HOSTILE))}


# Live.


def test_the_page_served_live(chromium: browsers.Browser) -> None:
    robot = chain(3)
    with meshcat.Server(meshcat.robot_page(robot, live=True), port=0) as server:
        shown = chromium.open(server.url, READY)
        q = np.array([0.3, -0.2, 0.5])
        shown.wait("performance.getEntriesByType('navigation').length")
        for _ in range(100):
            server.show(q, robot)
            shown.eval("new Promise((done) => setTimeout(done, 50))")
            found = np.array(shown.eval(f"({POSES})(0)")[-1]).reshape(4, 4).T
            if np.allclose(found[:3, 3], robot.frame_pose(robot.joint_names[-1], q).translation, atol=1e-5):
                break
        assert np.allclose(found[:3, 3], robot.frame_pose(robot.joint_names[-1], q).translation, atol=1e-5)
        # What a loop says beside it, with its histogram.
        for _ in range(100):
            server.show(q, robot, {"watchdog": "<b>"}, {"0 to 10": 3, "10 to 20": 6})
            shown.eval("new Promise((done) => setTimeout(done, 50))")
            texts = shown.eval("[...document.querySelectorAll('#gauges td')].map((x) => x.textContent)")
            if texts:
                break
        assert texts == ["<b>", "3", "6"]
        bars = shown.eval("[...document.querySelectorAll('#gauges i')].map((x) => x.style.width)")
        assert bars == ["50%", "100%"]
        assert shown.errors == []
        assert all(url.startswith((server.url, "data:", "blob:")) for url in shown.requests)


@pytest.mark.slow
def test_scenes_are_small() -> None:
    if "panda" not in robots.names():
        pytest.skip("example-robot-data is not installed")
    robot = Robot.load("panda", lock=["panda_finger_joint1"])
    assert len(meshcat.robot_page(robot)) < 6e6
    assert scene.build(robot).findings == ()


# Files can hold anything.

PAIR = compared(soft=run(ARM, t_final=0.1), stiff=run(ARM, t_final=0.1, omega=40.0))
SPOILED = {
    "no provenance": lambda d: d.assign_attrs(provenance=""),
    "other provenance": lambda d: d.assign_attrs(provenance='{"soft": {"plant": 3}}'),
    "no times": lambda d: d.assign_coords(time=np.full(d.sizes["time"], np.nan)),
    "times that go back": lambda d: d.isel(time=slice(None, None, -1)),
    "a status of its own": lambda d: d.assign(status=d["status"] + 7),
    "one name for all joints": lambda d: d.assign_coords(joint=["q"] * 3),
    "other dimensions": lambda d: d.transpose("joint", "time", "rollout", ...),
    "nothing finite": lambda d: d.assign(q=d["q"] * np.nan, q_ref=d["q_ref"] * np.nan, tau=d["tau"] * np.nan),
    "huge numbers": lambda d: d.assign(q=d["q"] * 1e300 + 1e300),
    "one sample": lambda d: d.isel(time=slice(1)),
    "no rollouts": lambda d: d.isel(rollout=slice(0)),
    "one of several": lambda d: d.isel(rollout=0),
    "no limits": lambda d: d.assign(effort=d["effort"] * np.inf),
    "no end": lambda d: d.assign(t_end=d["t_end"] * np.nan),
    "text": lambda d: d.assign(q=d["q"].astype(str)),
    "a number": lambda d: d.assign(q=3.0),
    "no joint types": lambda d: d.drop_vars("joint_type"),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("draw", [plots.overview, meshcat.rollout_page, report.build])
@pytest.mark.parametrize("what", SPOILED)
def test_a_spoiled_rollout_is_drawn_or_refused(what: str, draw: Callable[[xr.Dataset], object]) -> None:
    # Any other exception than ours fails the test.
    with contextlib.suppress(armgpi.ArmgpiError):
        draw(SPOILED[what](PAIR))


@pytest.mark.slow
def test_robots_stand_side_by_side_and_move_by_themselves(chromium: browsers.Browser, tmp_path: Path) -> None:
    robots = (ARM, chain(5, 3.0))
    shown = opened(chromium, meshcat.robot_page(*robots), tmp_path)
    quiet(shown)
    q = np.concatenate([robot.random_positions(1, seed=3)[0] for robot in robots])
    shown.eval(f"(armgpi.scene.configuration.set({q.tolist()}), armgpi.scene.show(0))")
    found = [np.array(each).reshape(4, 4).T for each in shown.eval(f"({POSES})(0)")]
    begin, at = 0, 0
    for robot in robots:
        model = robot.pinocchio_model()
        data = model.createData()
        pin.forwardKinematics(model, data, q[at : at + robot.n])
        aside = found[begin][:3, 3]
        for own, expected in zip(found[begin:], data.oMi, strict=False):
            np.testing.assert_allclose(own[:3, :3], expected.rotation, atol=1e-5)
            np.testing.assert_allclose(own[:3, 3] - aside, expected.translation, atol=1e-5)
        begin, at = begin + model.njoints, at + robot.n
    assert begin == len(found)
    assert aside[1] > 1.0
    names = [joint["name"] for joint in shown.eval("armgpi.scene.meta.arm.joints")]
    assert names == [f"{robot.name}: {name}" for robot in robots for name in robot.joint_names]


def test_a_report_begins_with_its_verdict_and_ends_with_where_it_came_from() -> None:
    one = run(ARM)
    html = report.build(compared(pid=one, gpi=one), ARM)
    parts = ("class=verdicts", "<table class=data", 'id="scene"', "Where it came from")
    places = [html.index(part) for part in parts]
    assert places == sorted(places)
    assert "<details open" not in html


def test_a_controller_has_one_colour_wherever_it_is() -> None:
    alone, among = style.looks(["pid"]), style.looks(["fixed gains", "network", "pid", "network (2)"])
    assert alone[0] == among[2] == style.looks(["gpi", "pid"])[1]
    assert len({look.color for look in among}) == 4
    assert among[0] == style.look(0)  # what has no colour of its own takes the first free one


def test_the_viewer_in_the_wheel_is_that_of_meshcat_and_its_licence_goes_along() -> None:
    viewer = resources.files("meshcat") / "viewer"
    ours = page.meshcat_script()
    assert ours.endswith((viewer / "dist" / "main.min.js").read_text(encoding="utf-8"))
    assert (viewer / "LICENSE").read_text(encoding="utf-8") in ours


def test_an_array_is_in_a_page_once_whoever_refers_to_it() -> None:
    arrays, zeros, ones = page.Arrays(), np.zeros(3), np.ones(5)
    places = [arrays.add(each, "float64") for each in (zeros, ones, zeros.copy(), [], ones, [2.0])]
    assert [each["offset"] for each in places] == [0, 24, 0, 64, 24, 64]
    packed = gzip.decompress(base64.b64decode(arrays.text()))
    assert np.frombuffer(packed).tolist() == [0.0] * 3 + [1.0] * 5 + [2.0]
