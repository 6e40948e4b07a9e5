"""A page to play with: what it shows, run as it is copied from there, has the same bits.

The tests in a browser are skipped where no Chromium is installed; CI installs one.
"""

from __future__ import annotations

import base64
import json
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import browser as browsers
import numpy as np
import pytest
import xarray as xr

import armgpi
from armgpi import config
from armgpi.base.arrays import Array
from armgpi.cli import main
from armgpi.codegen import build
from armgpi.config import Experiment
from armgpi.errors import ArmgpiWarning, BackendError, ParameterError
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.viewing import meshcat, play
from armgpi.viewing.play import controls, module, variant
from armgpi.viewing.play import page as play_page
from armgpi.viewing.play.loops import Listing, movable, tape_of

READY = "window.armgpi && (armgpi.ready || armgpi.error)"
PLAYED = """
robot: {name: anthropomorphic3}
plant: {encoder_bits: 16, delay: 1, payload: {mass: 0.05}}
controllers: [{type: gpi, omega: 25.0}]
reference: {points: [[0.0, 0.7854, 0.0], [0.3, 0.4, 0.2]], durations: [0.6], holds: [0.1, 0.0]}
t_final: 1.0
seed: 7
"""
TWISTING = PLAYED.replace(
    "anthropomorphic3}", "anthropomorphic3, rotor_inertia: [0.02, 0.02, 0.01]}"
).replace("plant: {", "plant: {engine: elastic, gear_stiffness: [300.0, 300.0, 200.0], ")
#: The tool (0.86 m, 0, 0.56 m) is pushed, and goes down into a floor.
TOUCHING = """
robot: {name: ur5}
plant:
  environment:
    - {type: force, force: [0.0, 20.0, 0.0], onset: 0.1, end: 0.3}
    - {type: wall, normal: [0.0, 0.0, 2.0], distance: 0.2, stiffness: 10000.0, damping: 100.0}
controllers: [{type: gpi}]
reference:
  points: [[0.0, -1.2, 1.5, -1.87, -1.57, 0.0], [0.0, -1.05, 1.5, -1.87, -1.57, 0.0]]
  durations: [1.0]
t_final: 1.2
"""
#: A spring comes down to a floor.
SPRUNG = """
robot: {name: ur5}
plant:
  delay: 1
  encoder_bits: 17
  environment: [{type: wall, normal: [0.0, 0.0, 1.0], distance: -0.05, stiffness: 10000.0, damping: 2.0}]
controllers: [{type: cartesian_impedance, force_limit: 30.0}]
t_final: 2.0
"""
#: A force limit around a controller that has none of its own.
LIMITED = PLAYED.replace("type: gpi, omega: 25.0", "type: pid_positions, force_limit: 20.0").replace(
    "anthropomorphic3}", "anthropomorphic3, friction: {viscous: 0.0, coulomb: 0.02}}"
)
#: Numbers of the page, as they are in memory.
BITS = """(name) => {
    const x = armgpi.page.result.values[name];
    return btoa(Array.from(new Uint8Array(x.buffer), (c) => String.fromCharCode(c)).join(""));
}"""


def experiment(text: str) -> Experiment:
    return config.build(*config.parse(text, "played"))


def make_few(patch: pytest.MonkeyPatch) -> None:
    """Give a page fewer forms and loads than it has, for a shorter test."""
    patch.setattr(controls, "_FORMS", {})
    patch.setattr(controls, "_ROTORS", (0.0, 20.0, 30.0))
    patch.setattr(controls, "_LOADS", 2)


@pytest.fixture(scope="module", params=[PLAYED])
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[browsers.Page]:
    """The page of the paper's arm in a browser, with four forms of its loop."""
    if browsers.program() is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(browsers.PROGRAMS)})")
    with pytest.MonkeyPatch.context() as patch:
        make_few(patch)
        html = play.build(experiment(request.param))
    running = browsers.Browser(size=(1300, 850))
    shown = running.open(meshcat.write(html, tmp_path_factory.mktemp("play") / "page.html"), READY)
    assert shown.eval("armgpi.error") is None
    yield shown
    assert shown.errors == []
    outside = [url for url in shown.requests if not url.startswith(("data:", "blob:"))]
    assert len(outside) == 1  # itself
    running.close()


def change(page: browsers.Page, code: str) -> None:
    """Do something in the page and wait until it has simulated anew."""
    before = page.eval("armgpi.page.count")
    page.eval(code)
    page.wait(f"armgpi.page.count > {before}")


def move(page: browsers.Page, control: str, place: int) -> None:
    """Move a slider by what a hand or a key does to it."""
    slider = f"[...document.querySelectorAll('input')].find((x) => x.dataset.id === {json.dumps(control)})"
    if page.eval(f"!{slider}.closest('.move').hidden") is not True:
        raise AssertionError(f"{control} is hidden")
    moved = f"x.value = {place}; x.dispatchEvent(new Event('input'));"
    change(page, f"(() => {{ const x = {slider}; {moved} }})()")


def choose(page: browsers.Page, choice: str, index: int) -> None:
    found = f"[...document.querySelectorAll('select')].find((x) => x.dataset.id === {json.dumps(choice)})"
    chosen = f"x.selectedIndex = {index}; x.dispatchEvent(new Event('change'));"
    change(page, f"(() => {{ const x = {found}; {chosen} }})()")


def run(text: str) -> xr.Dataset:
    """Run an experiment that was copied, by generated code."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # gains that are too fast for the delay
        made = experiment(text)
        (controller,) = made.controllers.values()
        return armgpi.simulate(made.plant, controller, made.reference, made.t_final, backend="compiled")


def assert_same_bits(page: browsers.Page) -> xr.Dataset:
    rollout = run(page.eval("armgpi.page.numbers.yaml()"))
    for name in ("q", "q_ref", "q_measured", "tau_command", "tau"):
        shown = np.frombuffer(base64.b64decode(page.eval(f"({BITS})('{name}')")))
        assert np.array_equal(shown.reshape(rollout[name].shape), rollout[name].values, equal_nan=True), name
    return rollout


@pytest.mark.slow
def test_controls_move_the_loop_and_the_bits_are_those_of_a_run(page: browsers.Page) -> None:
    rollout = assert_same_bits(page)
    shown = page.eval("armgpi.page.metrics.total")
    assert shown["itae"] == pytest.approx(float(armgpi.metrics.itae(rollout).sum()), rel=1e-9)
    assert shown["variation"] == pytest.approx(float(armgpi.metrics.total_variation(rollout).sum()), rel=1e-9)
    for control, place in (
        ("controllers.0.omega", 9),
        ("controllers.0.zeta", 20),
        ("plant.encoder_bits", 4),
        ("plant.encoder_bits", 14),  # the first that rounds the start in another way than 16 bits do
        ("plant.delay", 5),
        ("plant.drop_out", 3),
        ("plant.payload.mass", 1),
        ("plant.rotor_inertia", 2),
        ("controllers.0.inertia_scale", 3),
    ):
        move(page, control, place)
        assert_same_bits(page)
    move(page, "controllers.0.payload_range.heaviest", 2)
    assert page.eval("armgpi.page.numbers.experiment().controllers[0].inertia_scale") == 1.0
    move(page, "plant.encoder_bits", 17)
    assert "encoder_bits" not in page.eval("armgpi.page.numbers.yaml()")
    assert_same_bits(page)
    move(page, "reference.points.1.2", 0)  # as far as the joint goes
    move(page, "plant.loads.0.amplitude.1", 1)
    assert_same_bits(page)


@pytest.mark.parametrize("viscous", [0.0, 0.3])
def test_a_page_begins_with_the_friction_of_its_arm(viscous: float) -> None:
    """A realistic arm whose URDF contains no friction had 1 % of its effort limits in the page."""
    robot = f"{{name: anthropomorphic3, friction: {{viscous: {viscous}, coulomb: 0.0}}}}"
    text = PLAYED.replace("{name: anthropomorphic3}", robot).replace("plant: {", "plant: {friction: urdf, ")
    made = experiment(text)
    shown = controls.playable(made, "gpi", {}).config
    if viscous:
        assert shown["plant"]["friction"] == "urdf"
        assert shown["robot"]["friction"] == {"viscous": [viscous] * 3, "coulomb": [0.0] * 3}
    else:
        assert shown["plant"]["friction"] == "none"


@pytest.mark.slow
@pytest.mark.parametrize("page", [PLAYED.replace("omega: 25.0", "omega: [20.0, 25.0, 30.0]")], indirect=True)
def test_one_slider_scales_bandwidths_that_differ_by_joint(page: browsers.Page) -> None:
    assert_same_bits(page)
    move(page, "controllers.0.omega", 3)
    assert page.eval("armgpi.page.numbers.experiment().controllers[0].omega") == pytest.approx(
        [12.0, 15.0, 18.0]
    )
    assert_same_bits(page)


@pytest.mark.slow
def test_the_next_page_of_the_same_structure_compiles_nothing(
    page: browsers.Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_few(monkeypatch)
    monkeypatch.delattr(module, "compile_wasm")
    other = PLAYED.replace("25.0", "22.5").replace("[0.6]", "[0.7]").replace("0.4, 0.2", "0.3, 0.1")
    found = play_page.build_module(experiment(other), "gpi")
    assert module.layouts(found.code)[0]


@pytest.mark.search  # Zig makes a C library first, for half a minute
@pytest.mark.parametrize("page", [TWISTING], indirect=True)
def test_gears_that_twist_have_the_bits_of_a_run(page: browsers.Page) -> None:
    assert_same_bits(page)
    move(page, "plant.rotor_inertia", 2)
    assert_same_bits(page)


@pytest.mark.slow
def test_other_forms_and_pushes_have_the_bits_of_a_run(page: browsers.Page) -> None:
    change(page, "armgpi.page.reset()")
    assert_same_bits(page)
    choose(page, "controllers.0", 1)
    move(page, "controllers.0.omega.upper", 36)
    move(page, "controllers.0.learning_rate", 20)
    assert_same_bits(page)
    choose(page, "plant.friction", 1)
    move(page, "robot.friction.coulomb", 4)
    assert_same_bits(page)
    page.eval("armgpi.scene.show(0.3)")
    change(page, "armgpi.page.push_part(armgpi.page.link.length - 1)")
    rollout = assert_same_bits(page)
    pulse = page.eval("armgpi.page.numbers.short().plant.loads")
    assert [load["type"] for load in pulse] == ["pulse"]
    assert rollout["disturbance"].sel(time=0.4, method="nearest").any()
    python = page.eval("armgpi.page.numbers.python()")
    assert page.eval("armgpi.page.numbers.yaml()") in python
    compile(python, "played", "exec")
    assert "armgpi run --config played.yaml --backend compiled" in page.eval("armgpi.page.numbers.command()")


#: Where the middles of the arm's parts are in the window.
MIDDLES = """(() => {
    const scene = armgpi.scene, canvas = scene.viewer.renderer.domElement;
    const box = canvas.getBoundingClientRect();
    scene.viewer.camera.updateMatrixWorld();
    scene.robots[0].root.object.updateWorldMatrix(true, true);
    return scene.robots[0].meshes.map((mesh) => {
        mesh.geometry.computeBoundingSphere();
        const middle = mesh.geometry.boundingSphere.center.clone();
        const at = middle.applyMatrix4(mesh.matrixWorld).project(scene.viewer.camera);
        return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
    });
})()"""


#: Whether the arm moves as the run does that the curves show.
FOLLOWED = """(() => {
  const { play, joints, result } = armgpi.page, n = joints.length, every = Math.round(0.01 / play.dt);
  const of_run = (i) => result.values.q[Math.floor(i / n) * every * n + (i % n)];
  return armgpi.scene.clip.actors[0].q.every((x, i) => x === Math.fround(of_run(i)));
})()"""


@pytest.mark.slow
def test_the_arm_follows_the_curves(page: browsers.Page) -> None:
    change(page, "armgpi.page.reset()")
    move(page, "controllers.0.omega", 3)
    page.wait(FOLLOWED)


@pytest.mark.slow
@pytest.mark.parametrize("touch", [False, True], ids=["mouse", "finger"])
def test_a_click_on_the_arm_pushes_it(page: browsers.Page, touch: bool) -> None:
    change(page, "armgpi.page.reset()")
    page.call("Emulation.setTouchEmulationEnabled", enabled=touch)
    before = page.eval("armgpi.page.count")
    for x, y in page.eval(MIDDLES)[1:]:
        if touch:
            page.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
            page.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        else:
            for kind in ("mousePressed", "mouseReleased"):
                page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    page.call("Emulation.setTouchEmulationEnabled", enabled=False)
    page.wait(f"armgpi.page.count > {before}")
    loads = page.eval("armgpi.page.numbers.short().plant.loads")
    assert {load["type"] for load in loads} == {"pulse"}


@pytest.mark.slow
@pytest.mark.parametrize("page", [TOUCHING], indirect=True)
def test_walls_are_drawn_and_contacts_are_arrows(page: browsers.Page) -> None:
    rollout = run(page.eval("armgpi.page.numbers.yaml()"))
    samples = rollout.sizes["time"]
    assert float(abs(rollout["contact_force"]).max()) > 50.0
    pieces = [np.frombuffer(base64.b64decode(page.eval(f"({BITS})('contacts.{i}')"))) for i in range(2)]
    found = np.concatenate([piece.reshape(samples, 6) for piece in pieces], axis=1).reshape(samples, 2, 2, 3)
    # The last sample is that before, as of torques: they act until then.
    for i, name in enumerate(("contact_force", "contact_point")):
        assert found[:-1, :, i] == pytest.approx(rollout[name].values[:-1], rel=1e-9, abs=1e-9), name
    for time, visible in ((0.05, [False, False]), (0.2, [True, False]), (1.1, [False, True])):
        page.eval(f"armgpi.scene.show({time})")
        assert page.eval("armgpi.scene.arrows[0].map((arrow) => arrow.visible)") == visible
    at = page.eval("armgpi.scene.arrows[0][1].position.toArray()")
    assert at == pytest.approx(rollout["tool"].sel(time=1.1, method="nearest").values, abs=1e-4)
    pressed = rollout["contact_force"].sel(time=1.1, method="nearest").values[1]
    up = page.eval(
        "(() => { const s = armgpi.scene; const v = new s.THREE.Vector3(0, 1, 0);"
        " return v.applyQuaternion(s.arrows[0][1].quaternion).toArray(); })()"
    )
    assert up == pytest.approx(pressed / np.linalg.norm(pressed), abs=1e-6)
    walls = page.eval("armgpi.scene.clip.walls")
    assert [(x["normal"], x["distance"], x["contact"]) for x in walls] == [([0.0, 0.0, 1.0], 0.2, 1)]
    # What is moved changes the arrows, too.
    change(page, "(() => { armgpi.page.push_part(4); })()")
    page.wait("armgpi.scene.clip.actors[0].forces.some((x) => x !== 0)")
    page.eval("armgpi.scene.show(1.1)")
    assert page.eval("armgpi.scene.arrows[0].map((arrow) => arrow.visible)") == [False, True]


def assert_near(page: browsers.Page) -> xr.Dataset:
    """The page shows what a run gives but for roundings; the run is returned."""
    rollout = run(page.eval("armgpi.page.numbers.yaml()"))
    for name in ("q", "tau_command"):
        shown = np.frombuffer(base64.b64decode(page.eval(f"({BITS})('{name}')")))
        expected = rollout[name].values
        assert shown.reshape(expected.shape) == pytest.approx(expected, rel=1e-9, abs=1e-9), name
    return rollout


@pytest.mark.slow
@pytest.mark.parametrize("page", [SPRUNG], indirect=True)
def test_stiffness_damping_force_limit_and_wall_have_sliders(page: browsers.Page) -> None:
    """The page works out what the run does, but for the rounding of an arc tangent of another library."""

    def final_force() -> float:
        rollout = assert_near(page)
        shown = page.eval("armgpi.page.metrics.total")
        assert shown["tool"] == pytest.approx(float(armgpi.metrics.tool_error(rollout)[0]), rel=1e-9)
        assert shown["press"] == pytest.approx(float(armgpi.metrics.peak_force(rollout)[0]), rel=1e-6)
        last = np.linalg.norm(rollout["contact_force"].isel(time=-2, contact=0))
        assert shown["end"] == pytest.approx(float(last), rel=1e-6)
        return float(armgpi.metrics.final_force(rollout)[0])

    titles = page.eval("armgpi.page.curves.cells.slice(0, 2).map((cell) => cell.title)")
    assert titles == ["tool · error [mm]", "tool · contact force [N]"]
    assert final_force() == pytest.approx(30.0, abs=3.0)
    move(page, "controllers.0.force_limit", 3)
    assert final_force() < 15.0
    move(page, "controllers.0.stiffness", 7)
    move(page, "controllers.0.damping_ratio", 0)
    move(page, "plant.environment.0.stiffness", 0)
    section = page.eval("armgpi.page.numbers.experiment().controllers[0]")
    assert section["stiffness"] == [1000.0] * 3 + [60.0] * 3
    assert section["damping_ratio"] == 0.4
    final_force()
    labels = page.eval("armgpi.page.play.controls.map((control) => control.label)")
    assert {"stiffness", "damping ratio", "wall stiffness"} <= set(labels)
    choose(page, "plant.friction", 1)  # which the model has as well then
    final_force()


@pytest.mark.slow
@pytest.mark.parametrize("page", [LIMITED], indirect=True)
def test_a_force_limit_around_a_controller_has_a_slider(page: browsers.Page) -> None:
    move(page, "controllers.0.force_limit", 0)
    assert_near(page)
    move(page, "controllers.0.inertia_scale", 3)
    assert_near(page)
    choose(page, "plant.friction", 1)
    assert_near(page)


@pytest.mark.slow
def test_a_frozen_run_stays_beside_what_is_moved(page: browsers.Page) -> None:
    change(page, "armgpi.page.reset()")
    page.eval("document.getElementById('freeze').click()")
    before = page.eval("armgpi.page.frozen.result.values.q[100]")
    move(page, "controllers.0.omega", 5)
    assert page.eval("armgpi.page.frozen.result.values.q[100]") == before
    assert page.eval("document.querySelectorAll('#verdict tbody tr').length") == 2
    assert page.eval("armgpi.scene.robots[1].root.object.visible")
    page.eval("document.getElementById('freeze').click()")
    assert not page.eval("armgpi.scene.robots[1].root.object.visible")


@pytest.mark.slow
def test_the_page_fits_a_phone(page: browsers.Page) -> None:
    page.size(390, 844, mobile=True)
    page.wait("document.documentElement.scrollWidth <= 390")
    page.size(1300, 850)


def test_gains_come_from_the_tuning_by_the_tape() -> None:
    made = experiment(PLAYED)
    for text in ("rolloff: 0", "rolloff: 1, rolloff_ratio: 2.7", "integrators: 3, rolloff: 2"):
        (controller,) = experiment(
            PLAYED.replace("omega: 25.0", f"omega: 31.7, zeta: 0.83, {text}")
        ).controllers.values()
        loop = movable(ClosedLoop(made.plant, controller, made.reference))
        listed = Listing(loop)
        shared, tape = listed.values.shared, tape_of(loop, listed)
        assert tape is not None
        values: list[float] = []
        for operation, *steps in tape.steps:
            if operation in ("place", "number"):
                values.append(shared[steps[0]] if operation == "place" else steps[0])
                continue
            a, b = (values[step] for step in steps)
            values.append({"+": a + b, "-": a - b, "*": a * b}[operation] if operation != "/" else a / b)
        assert len(tape.outputs) > made.robot.n
        for at, place in tape.outputs:
            assert values[at] == shared[place]


def test_a_movable_loop_has_the_bits_of_the_one_that_it_was_made_of() -> None:
    made = experiment(PLAYED)
    (controller,) = made.controllers.values()
    moved = movable(ClosedLoop(made.plant, controller, made.reference))

    def torque(plant: armgpi.Plant, law: armgpi.Controller) -> Array:
        rollout = armgpi.simulate(plant, law, made.reference, 0.3, backend="compiled")
        found: Array = rollout["tau"].values
        return found

    assert np.array_equal(torque(made.plant, controller), torque(moved.plant, moved.controller))


NOISY = PLAYED.replace("plant: {", "plant: {noise: {position: 1.0e-4, velocity: 1.0e-3}, ")


@pytest.mark.parametrize(("text", "kind"), [(NOISY, "gpi"), (TWISTING, "network")], ids=["gpi", "network"])
def test_a_slider_gives_the_numbers_of_a_loop_that_is_made_anew(text: str, kind: str) -> None:
    made = experiment(text)
    makers = play_page._Makers(made)
    moved = controls.playable(made, "gpi", makers.siblings("gpi"))
    form = {"controllers.0": kind, "controllers.0.rolloff": 1, "plant.friction": "urdf"}
    form["controllers.0.feedforward"] = "none"
    own = play_page._belonging(moved, form)
    prober = variant.Prober(form, play_page.compose_config(moved, form), own, makers.loop, variant.Pool())
    used = [*prober.trace()[1].layout.shared, *range(prober.shared, len(prober.first))]
    told = []
    for control in own:
        if not prober._changes(control.id)[used].any():
            continue
        told.append(control.id)
        values = prober._values(control.id)
        for i in {0, len(values) // 2, len(values) - 1 - (values[-1] is None)}:
            value = np.asarray(values[i]).tolist()
            listed = Listing(movable(prober._loop({control.id: value})))
            numbers = np.concatenate([listed.values.shared, listed.start[0]])
            assert np.array_equal(numbers[used], prober._probed[control.id][i][used]), (control.id, value)
    assert len(told) > 20
    assert ("plant.noise.velocity" in told) == (text is NOISY)


def test_a_start_that_no_table_holds_leaves_a_slider_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "_MOST", 20)  # 18 encoders times 13 factors of the nominal inertia are more
    made = experiment(PLAYED)
    moved = controls.playable(made, "gpi", {})
    form = {choice.id: choice.value for choice in moved.choices}
    own = [control for control in moved.controls if control.only is None]
    config = play_page.compose_config(moved, form)
    pool = variant.Pool()
    prober = variant.Prober(form, config, own, play_page._Makers(made).loop, pool)
    _, sample = prober.trace()
    pool.names = [kernel.name for kernel in prober.kernels(sample)]
    found = prober.variant(sample)
    assert "plant.encoder_bits" in found["unmoved"]
    assert all(len(table.controls) == 1 or len(table.values) <= 20 for table in found["tables"])


def test_without_the_compiler_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(BackendError, match=r"pip install ziglang"):
        play.build(experiment(PLAYED))
    monkeypatch.setattr("sys.argv", ["armgpi", "play", "anthropomorphic3", "-o", str(tmp_path / "a.html")])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert "pip install ziglang" in said
    assert "Traceback" not in said
    assert not (tmp_path / "a.html").exists()


@pytest.mark.slow
def test_clang_makes_a_page_with_the_same_bits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    if browsers.program() is None or not Path("/usr/include/wasm32-wasi").is_dir():
        pytest.skip("no browser, or no Clang for WebAssembly (Debian: clang lld wasi-libc)")
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    if not all(map(shutil.which, ("clang", "wasm-ld"))):
        pytest.skip("no Clang that links WebAssembly")
    assert "clang" in module.compiler()[0]
    monkeypatch.setattr(controls, "_FORMS", {})
    monkeypatch.setattr(controls, "_ROTORS", (0.0,))
    monkeypatch.setattr(controls, "_LOADS", 1)
    html = play.build(experiment(PLAYED))
    running = browsers.Browser()
    try:
        shown = running.open(meshcat.write(html, tmp_path / "page.html"), READY)
        assert shown.eval("armgpi.error") is None
        assert_same_bits(shown)
    finally:
        running.close()


def test_where_functions_of_a_c_library_are_called_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "wasm", lambda code, found, flags, name: " ".join(flags).encode())
    zig, clang = (build.Compiler(command, "") for command in (build.ZIG, ("clang",)))
    for compiler, code, target in (
        (zig, "x = v_tanh(y);", b"wasm32-wasi"),
        (zig, "x = v_exp(y);", b"wasm32-freestanding"),  # the compiler has it itself
        (clang, "x = v_exp(y);", b"wasm32-wasi"),
        (zig, "V v_exp(V x);", b"wasm32-freestanding"),
        (clang, "V v_exp(V x);", b"-nostdlib"),
    ):
        monkeypatch.setattr(module, "_compiler", lambda compiler=compiler: compiler)
        assert target in module.compile_wasm(code)


def test_what_has_no_page_is_refused() -> None:
    with pytest.raises(ParameterError, match="label"):
        play.build(experiment(PLAYED), "somebody")
    with pytest.raises(ParameterError, match="reality"):
        play.build(experiment("robot: {name: anthropomorphic3}\nreality: {name: geared, seed: 2}"))


def test_zig_compiles_where_there_is_no_other_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    assert build.compiler().command == build.ZIG
    monkeypatch.setattr(build, "find_spec", lambda name: None)
    with pytest.raises(BackendError, match="pip install ziglang"):
        build.compiler()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--plant", "both"], "one with a single plant"),
        (["--supervised"], "one without a supervisor"),
        (["--frame", "nowhere"], "there is no frame named 'nowhere'"),
        (["--set", "plant.environment.0.distance=2.2"], "a wall that 'ee_link' starts before"),
    ],
)
def test_what_no_page_can_have_is_refused_before_anything_is_said(
    options: list[str],
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    floor = TOUCHING.replace("    - {type: force, force: [0.0, 20.0, 0.0], onset: 0.1, end: 0.3}\n", "")
    (tmp_path / "floor.yaml").write_text(floor)
    out = str(tmp_path / "page.html")
    monkeypatch.setattr("sys.argv", ["armgpi", "play", str(tmp_path / "floor.yaml"), "-o", out, *options])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert reason in line
