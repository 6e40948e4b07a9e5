"""The page: scene, plots and controls in one file, with the loop as WebAssembly."""

from __future__ import annotations

import itertools
import json
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.escape import json_data
from armgpi.codegen.kernels import Kernel
from armgpi.codegen.symbols import NotElementwise
from armgpi.config import Origin, check, keys
from armgpi.config import build as build_experiment
from armgpi.config.building import Experiment, Parts
from armgpi.config.schema import SECTIONS, PlantSection, RobotSection
from armgpi.errors import ArmgpiError, ArmgpiWarning, BackendError, ParameterError
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.runner import DIVERGENCE
from armgpi.plants.plant import inside
from armgpi.robot.markup import read_file
from armgpi.viewing import page, scene, style
from armgpi.viewing.play import module
from armgpi.viewing.play.controls import Control, Playable, dotted_path, plain, playable, siblings
from armgpi.viewing.play.variant import Pool, Prober

#: Keys of a reference that a page leaves out where they are not given.
_REFERENCE_KEYS = (
    *("path", "poses", "stream", "frame", "direction", "tool_axis"),
    *("feedforward", "torque_rate", "start"),
)
#: Called with what is being done and how much of it is done [0, 1].
Progress = Callable[[str, float], None]

#: Keys that the other controllers of a page take over.
_SHARED = (
    *("inertia_scale", "payload_range", "rolloff", "rolloff_ratio", "feedforward", "integrators"),
    *("force_limit", "moment_limit", "force_frame", "speed_limit", "limit_friction"),
)


class Module(NamedTuple):
    """All forms of an experiment's loop.

    Attributes:
        playable: what can be moved.
        variants: the forms; see :meth:`Prober.variant`.
        code: WebAssembly.
    """

    playable: Playable
    variants: list[dict[str, Any]]
    code: bytes


def build(
    experiment: Experiment,
    label: str | None = None,
    *,
    frame: str | None = None,
    title: str | None = None,
    more: str = "",
    progress: Progress = lambda *_: None,
) -> str:
    """Return a page in which an experiment is simulated anew when something in it is moved, as HTML.

    Args:
        experiment: from :func:`armgpi.config.build`.
        label: which of its controllers; the first one when not given.
        frame: the tool, whose path is drawn; the tip when not given.
        title: what the page is called; the robot's name when not given.
        more: HTML below it.
        progress: called with what is being done, and how much of all is done.

    Raises:
        BackendError: when the package `ziglang` is not installed, or the loop has no generated code.
        ParameterError: when there is no such controller, or with an uncertainty model, a supervisor or two
            simulators.
        MissingPackage: when trimesh is not installed.
    """
    check_experiment(experiment, frame)
    if label is None:
        label = next(iter(experiment.controllers))
    module_of_forms = build_module(experiment, label, progress)
    arm = scene.build(experiment.robot, frame)
    arrays = page.Arrays()
    data = {
        "arm": page.arm_data(arm, arrays),
        "clip": None,
        "play": _data(module_of_forms, experiment, arrays),
    }
    values = {
        "title": page.text(title or experiment.robot.name),
        "findings": page.bullets(arm.findings, "findings"),
        "more": more,
    }
    names = ("scene.js", "loop.js", "curves.js", "play.js")
    scripts = [page.meshcat_script(), *map(page.asset, names)]
    return page.fill("play.html", values, data, arrays, scripts, computes=True)


def _data(found: Module, experiment: Experiment, arrays: page.Arrays) -> dict[str, Any]:
    """Return what the page knows of the loop and its controls."""
    controller = next(iter(experiment.controllers.values()))
    loop = ClosedLoop(experiment.plant, controller, experiment.reference)
    steps = round(experiment.t_final / loop.dt)
    moved = found.playable
    config = moved.config
    urdf = None
    path = Path(config["robot"]["name"])
    if path.is_file():  # it lies beside the configuration that is copied from the page
        config = {**config, "robot": {**config["robot"], "name": path.name}}
        urdf = [path.name, read_file(path)]
    arm = inside(experiment.plant)
    contacts = [contact.describe() for contact in getattr(arm, "environment", ())]
    # Bounds that are infinite are null.
    controls = [json_data({**control._asdict(), "id": control.id}) for control in moved.controls]
    return {
        "walls": [wall._asdict() for wall in scene.walls(contacts)],
        "contacts": len(contacts),
        "steps": steps,
        "dt": loop.dt,
        "divergence": DIVERGENCE,
        "code": arrays.add(np.frombuffer(found.code, dtype=np.uint8), "uint8"),
        "colors": [style.PALETTE[0], style.PALETTE[1]],
        "choices": [{**choice._asdict(), "id": choice.id} for choice in moved.choices],
        "controls": controls,
        "sections": moved.sections,
        "config": config,
        "urdf": urdf,
        "friction": plain(experiment.config)["robot"]["friction"],
        "defaults": _defaults(moved),
        "variants": [_variant(variant, loop, steps, arrays) for variant in found.variants],
    }


def _variant(variant: dict[str, Any], loop: ClosedLoop, steps: int, arrays: page.Arrays) -> dict[str, Any]:
    """Return what the page knows of a form."""
    table = None
    if variant["layout"].table:
        targets = loop.targets(np.arange(steps + 1) * np.float64(loop.dt))
        table = arrays.add(np.concatenate(targets, axis=-1), "float64")
    data = {key: _with_arrays(value, arrays) for key, value in variant.items()}
    return {**data, "table": table}


def _with_arrays(data: Any, arrays: page.Arrays) -> Any:
    """Return data as JSON has it, with arrays by their places."""
    if isinstance(data, np.ndarray):
        return arrays.add(data, "float64")
    if hasattr(data, "_asdict"):
        return {key: _with_arrays(value, arrays) for key, value in data._asdict().items()}
    if isinstance(data, list | tuple):
        return [_with_arrays(item, arrays) for item in data]
    return data


def _defaults(moved: Playable) -> dict[str, Any]:
    """Return what an experiment file need not say."""
    controllers = {}
    for kind in moved.sections:
        section = SECTIONS[kind](type=kind).plain()
        section.pop("type", None)
        controllers[kind] = section
    robot = RobotSection(name="").plain()
    robot.pop("name", None)
    return {
        "robot": robot,
        "plant": PlantSection().plain(),
        "controllers": controllers,
        "reference": dict.fromkeys(_REFERENCE_KEYS),
        "reality": None,
        "supervisor": None,
        "record_every": 1,
        "seed": 0,
    }


def check_experiment(experiment: Experiment, frame: str | None = None) -> None:
    """Refuse an experiment that no page simulates, or a frame that its arm does not have.

    Raises:
        ParameterError: with an uncertainty model, a supervisor or two simulators.
        NameNotFound: when there is no such frame.
    """
    for key in ("reality", "supervisor"):
        if getattr(experiment.config, key) is not None:
            raise ParameterError("experiment", f"one with a {key}", f"one without a {key}: a page has none")
    if len(experiment.plants) > 1:
        raise ParameterError("experiment", "one with two plants", "one with a single plant: a page has one")
    if frame is not None:
        experiment.robot.frame_pose(frame, experiment.robot.middle())


def build_module(experiment: Experiment, label: str, progress: Progress = lambda *_: None) -> Module:
    """Return all forms of an experiment's loop as WebAssembly.

    Args:
        experiment: from :func:`armgpi.config.build`.
        label: which of its controllers.
        progress: called with how far it is.

    Raises:
        BackendError: when Zig is not installed, or a loop has no generated code.
    """
    module.compiler()
    check_experiment(experiment)
    makers = _Makers(experiment)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # of controllers that nobody asked for
        others = makers.siblings(label)
        moved = _possible(playable(experiment, label, others), makers)
        pool = Pool()
        probers = []
        for form in _forms(moved):
            config = compose_config(moved, form)
            probers.append(Prober(form, config, _belonging(moved, form), makers.loop, pool))
        try:
            code = _module(probers, progress)
        except NotElementwise as error:
            raise BackendError(f"this loop has no generated code: {error}") from None
        pool.names, samples = module.layouts(code)
        variants = [prober.variant(sample) for prober, sample in zip(probers, samples, strict=True)]
    return Module(moved, variants, code)


def _module(probers: Sequence[Prober], progress: Progress) -> bytes:
    """Return WebAssembly of all forms, that which was made before where there is such."""
    names = [prober.name for prober in probers]
    name = "\n".join(names) if all(names) else ""
    made_before = module.find(name)
    if made_before is not None:
        return made_before
    traces, samples = [], []
    kernels: dict[str, Kernel] = {}
    stages = len(probers) + 2
    for i, prober in enumerate(probers):
        progress("tracing", i / stages)
        traced, sample = prober.trace()
        traces.append(traced)
        samples.append(sample)
        for call in traced.calls:
            kernels[call.kernel.name] = call.kernel
        for kernel in prober.kernels(sample):
            kernels[kernel.name] = kernel
    progress("compiling", len(probers) / stages)
    return module.compile_wasm(module.text(traces, samples, kernels), name)


def _possible(moved: Playable, makers: _Makers) -> Playable:
    """Return what can be moved without loads of the nominal model that no bandwidth serves."""

    def serves(control: Control, mass: float) -> bool:
        for form in forms:
            config = compose_config(moved, form)
            control.put(config, mass)
            try:
                makers.loop(config)
            except ArmgpiError:
                return False
        return True

    forms = [form for form in _forms(moved) if form["plant.friction"] == "none"]
    controls = []
    for control in _buildable(moved, makers):
        if control.arm == "controller":
            served = [x for x in control.values if x == control.value or serves(control, x)]
            control = control._replace(stops=tuple(served), values=tuple(served))
        controls.append(control)
    return moved._replace(controls=tuple(controls))


def _buildable(moved: Playable, makers: _Makers) -> list[Control]:
    """Return controls without places at which a controller that is made anew there would be refused.

    A stiffness is left out that is refused with one of the damping ratios, as the two are moved together.
    """

    def serves(moves: Sequence[tuple[Control, Any]]) -> bool:
        config = json.loads(json.dumps(moved.config))
        kinds = [control.only[1] for control, _ in moves if control.only is not None]
        config["controllers"] = [dict(moved.sections[kinds[0]])]
        for control, value in moves:
            control.put(config, value)
        try:
            makers.loop(config)
        except ArmgpiError:
            return False
        return True

    ratios = [x for x in moved.controls if x.rebuilds and x.path[-1] == "damping_ratio"]
    ratio = ratios[0] if ratios else None
    if ratio is not None:
        served = [x for x in ratio.values if x == ratio.value or serves([(ratio, x)])]
        ratio = ratio._replace(stops=tuple(served), values=tuple(served))

    controls = []
    for control in moved.controls:
        if ratio is not None and control.id == ratio.id:
            controls.append(ratio)
        else:
            controls.append(_with_places_served(control, ratio, serves) if control.rebuilds else control)
    return controls


def _with_places_served(
    control: Control, ratio: Control | None, serves: Callable[[Sequence[tuple[Control, Any]]], bool]
) -> Control:
    """Return a control with the places that are served; those of a stiffness with all damping ratios."""
    beside = []
    if ratio is not None and "stiffness" in control.id:
        beside = [(ratio, x) for x in ratio.values]
    places = {}
    for stop, value in zip(control.stops, control.values, strict=True):
        move = (control, value)
        together = [[move, other] for other in beside] or [[move]]
        if value == control.value or all(map(serves, together)):
            places[stop] = value
    return control._replace(stops=tuple(places), values=tuple(places.values()))


def compose_config(moved: Playable, form: dict[str, Any]) -> dict[str, Any]:
    """Return the experiment of a form, as plain data, as it is traced.

    The plant has a load, so that its equations of motion are not the nominal model's.
    """
    config: dict[str, Any] = json.loads(json.dumps(moved.config))
    config["controllers"] = [dict(moved.sections[form["controllers.0"]])]
    for choice in moved.choices[1:]:
        if choice.id in form:
            keys.put(config, choice.path, form[choice.id])
    if form["plant.friction"] == "none":
        config["robot"]["friction"] = moved.friction
    for control in _belonging(moved, form):
        if control.arm == "plant" and control.whole is not None:
            control.put(config, control.values[1])
        elif control.joints and control.id.startswith("plant.loads"):
            control.put(config, [1.0] * len(control.joints))
    plant = config["plant"]
    for key, value in {"encoder_bits": 16, "drop_out": 0.5, "delay": 1}.items():
        plant[key] = plant[key] or value  # drop-outs are drawn with the experiment's seed
    return config


def _belonging(moved: Playable, form: dict[str, Any]) -> list[Control]:
    """Return the controls that a form has."""
    belonging = []
    for control in moved.controls:
        if control.only is not None:
            path, value = control.only
            if form.get(dotted_path(path)) != value:
                continue
        belonging.append(control)
    return belonging


def _forms(moved: Playable) -> Iterator[dict[str, Any]]:
    """Yield each form once: id of a choice -> its value, without choices that a controller does not have."""
    seen = []
    for values in itertools.product(*(choice.values for choice in moved.choices)):
        kind = values[0]  # the first choice is the controller
        form = {}
        for choice, value in zip(moved.choices, values, strict=True):
            if not choice.only or kind in choice.only:
                form[choice.id] = value
        if form not in seen:
            seen.append(form)
            yield form


class _Makers:
    """Makes loops of experiments as plain data."""

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self._parts = Parts()

    def loop(self, config: dict[str, Any]) -> ClosedLoop:
        """Return the loop of the first controller."""
        return ClosedLoop(*self._parts.of(check(config, Origin("the page's experiment"))))

    def siblings(self, label: str) -> dict[str, dict[str, Any]]:
        """Return the sections of the other controllers that the page has, defaults filled in."""
        config = plain(self.experiment.config)
        by_label = {}
        for section in reversed(config["controllers"]):  # of one label the first
            by_label[section["label"]] = section
        if label not in by_label:
            labels = [section["label"] for section in config["controllers"]]
            raise ParameterError("label", label, ", ".join(labels))
        section = by_label[label]
        sections = {}
        for kind in siblings(section["type"]):
            shared = {key: section[key] for key in _SHARED if key in section}
            config["controllers"] = [{"type": kind, **shared}]
            experiment = build_experiment(check(config, Origin()))
            sections[kind] = plain(experiment.config)["controllers"][0]
        return sections
