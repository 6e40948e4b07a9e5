"""Figures: what is drawn is what is in the rollout, nothing overlaps, and a file is the same each time."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from pictured import HOSTILE, chain, compared, made_up, run

import armgpi
from armgpi import GPI, Bezier, BSplineNetwork, RigidBodyPlant, Robot, metrics, simulate
from armgpi.errors import NameNotFound, ParameterError, RolloutError
from armgpi.viewing import plots, style, tracks

ARM = Robot.load("anthropomorphic3")
ONE = run(ARM)
TWO = compared(soft=ONE, stiff=run(ARM, omega=40.0))


def line(axes: object, label: str) -> np.ndarray:
    """The y values of the line that a label names."""
    (found,) = [one for one in axes.get_lines() if one.get_label() == label]  # type: ignore[attr-defined]
    return np.asarray(found.get_ydata())


def texts_overlap(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of texts of a figure that cover each other."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw_without_rendering()
    boxes = []
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        items = [axes.title, axes.xaxis.label, axes.yaxis.label, axes.yaxis.get_offset_text(), *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            items += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        boxes += [
            (t.get_text(), t.get_window_extent(renderer)) for t in items if t.get_text() and t.get_visible()
        ]
    boxes += [(t.get_text(), t.get_window_extent(renderer)) for g in figure.legends for t in g.get_texts()]
    return [
        (a, b)
        for i, (a, one) in enumerate(boxes)
        for b, other in boxes[i + 1 :]
        if one.width and other.width and one.shrunk(0.98, 0.9).overlaps(other.shrunk(0.98, 0.9))
    ]


def test_what_is_drawn_is_what_is_in_the_rollout() -> None:
    figure = plots.overview(TWO)
    rows = np.array(figure.axes).reshape(3, 3)
    for j in range(3):
        position, error, torque = rows[j]
        for i, label in enumerate(("soft", "stiff")):
            own = TWO.isel(rollout=i, joint=j)
            assert np.array_equal(line(position, label), own["q"])
            assert np.array_equal(line(error, label), metrics.error(own))
            assert np.array_equal(line(torque, label), own["tau"])
        assert np.array_equal(line(position, "reference"), TWO["q_ref"].isel(rollout=0, joint=j))
        onset = [one for one in error.get_lines() if one.get_label() == "disturbance sets in"]
        assert onset[0].get_xdata()[0] == pytest.approx(0.1)
    assert len(figure.legends) == 1


def test_axes_say_joint_quantity_and_unit() -> None:
    figure = plots.overview(made_up(chain(3)))
    rows = np.array(figure.axes).reshape(3, 3)
    assert [row[0].get_title() for row in rows] == ["joint0", "joint1", "joint2"]
    assert [axes.get_ylabel() for axes in rows[0]] == ["position [rad]", "error [rad]", "torque [N m]"]
    assert [axes.get_ylabel() for axes in rows[1]] == ["position [m]", "error [m]", "force [N]"]
    assert [axes.get_xlabel() for axes in rows[2]] == ["time [s]"] * 3


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 5, 14])
@pytest.mark.parametrize("draw", [plots.overview, plots.torques])
def test_no_text_covers_another(n: int, draw: object) -> None:
    names = [f"left_shoulder_pitch_joint_with_a_long_name_{i}" for i in range(n)]
    robot = chain(n, joints=names)
    rollout = compared(
        **{"a soft one": made_up(robot), "a stiff one with a name that goes on and on": made_up(robot)}
    )
    assert texts_overlap(draw(rollout)) == []  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.parametrize("kind", plots.FORMATS)
def test_the_same_rollout_makes_the_same_file(kind: str, tmp_path: Path) -> None:
    first = plots.save(plots.errors(TWO, ["q1"]), tmp_path / f"a.{kind}").read_bytes()
    with mpl.rc_context({"font.size": 20, "lines.linewidth": 9}):  # the user's own style does not get in
        second = plots.save(plots.errors(TWO, ["q1"]), tmp_path / f"b.{kind}").read_bytes()
    assert first == second
    figure = plots.tool_path(ONE, ARM)
    again = [plots.save(figure, tmp_path / f"{i}.{kind}").read_bytes() for i in range(2)]
    assert again[0] == again[1]


def test_a_composed_figure_uses_the_same_colours() -> None:
    with plots.styled():
        figure, axes = plots.panels(rows=1, columns=2)
        plots.plot_positions(axes[0, 0], TWO, "q1")
        plots.plot_error(axes[0, 1], TWO, "q2")
        plots.legend(figure)
    colors = {one.get_label(): one.get_color() for one in axes[0, 1].get_lines()}
    assert colors["soft"] == style.PALETTE[0]
    assert colors["stiff"] == style.PALETTE[1]
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == list(dict.fromkeys(names))


def test_styles_leave_no_trace() -> None:
    before = dict(mpl.rcParams)
    plots.overview(ONE)
    assert dict(mpl.rcParams) == before


def test_signals_of_networks_are_drawn() -> None:
    controller = GPI(ARM, dt=1e-3, gains=BSplineNetwork())
    reference = Bezier(start=np.zeros(3), goal=np.full(3, 0.2), duration=0.1)
    rollout = simulate(RigidBodyPlant(ARM), controller, reference, t_final=0.1, signals=True)
    figure = plots.signals(rollout, ["omega_c", "omega_c_weight_1", "omega_c_weight_2"], ["q1"])
    gain, weights = figure.axes
    assert np.array_equal(line(gain, "omega_c"), rollout["omega_c"].sel(joint="q1"))
    assert np.array_equal(line(weights, "omega_c_weight_2"), rollout["omega_c_weight_2"].sel(joint="q1"))
    assert texts_overlap(figure) == []
    with pytest.raises(NameNotFound, match="omega_c"):
        plots.signals(rollout, ["omega"])
    with pytest.raises(RolloutError, match="signals=True"):
        plots.signals(ONE)


def test_tool_paths_are_those_of_the_kinematics() -> None:
    (path,) = tracks.tool_paths(ONE, ARM)
    assert np.allclose(path.drawn, ARM.frame_pose(ARM.tip, ONE["q"].values).translation)
    assert np.allclose(path.desired, ARM.frame_pose(ARM.tip, ONE["q_ref"].values).translation)
    figure = plots.tool_path(ONE, ARM, frame=ARM.frame_names[2])
    assert len(figure.axes) == 2
    with pytest.raises(RolloutError, match="joints"):
        tracks.tool_paths(ONE, chain(3))


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=30))
def test_the_pareto_front_is_what_nothing_beats(points: list[tuple[int, int]]) -> None:
    array = np.array(points, dtype=float).reshape(-1, 2)
    best = tracks.pareto_front(array)
    for i, p in enumerate(array):
        beaten = any((q <= p).all() and (q < p).any() for q in array)
        assert best[i] == (not beaten)


def test_pareto_fronts_of_several_sets() -> None:
    rng = np.random.default_rng(0)
    figure = plots.pareto(
        {"a": rng.lognormal(size=(40, 2)), "b": [[1.0, np.inf], [2.0, 3.0]]}, ("x [s]", "y [m]")
    )
    (axes,) = figure.axes
    assert axes.get_xlabel() == "x [s]"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "a, Pareto front",
        "b, Pareto front",
    ]
    with pytest.raises(ParameterError, match="shape"):
        plots.pareto([1.0, 2.0])


def test_many_rollouts_become_a_band() -> None:
    many = xr.concat([ONE] * 40, dim="rollout", data_vars="all")
    (position, *_) = plots.overview(many).axes
    assert len(position.collections) == 1
    assert len(position.get_lines()) < 10


def test_a_rollout_that_diverged_ends_with_a_cross() -> None:
    t_end = 0.1
    rollout = ONE.copy(deep=True)
    rollout["status"].data = np.int32(armgpi.Status.DIVERGED)
    rollout["t_end"].data = np.float64(t_end)
    (axes, *_) = plots.positions(rollout).axes
    (cross,) = [one for one in axes.get_lines() if one.get_label() == "diverged"]
    assert np.asarray(cross.get_xdata())[0] == pytest.approx(t_end, abs=1.5e-3)
    assert np.isnan(line(axes, "actual")[rollout["time"] > t_end]).all()


@pytest.mark.slow
def test_a_path_in_space_has_the_same_scale_along_all_axes_about_its_middle() -> None:
    figure = Figure()
    axes: Any = figure.add_subplot(projection="3d")
    plots.plot_path_space(axes, ONE, ARM)
    (path,) = tracks.tool_paths(ONE, ARM)
    every = np.concatenate([path.desired, path.drawn])
    every = every[np.isfinite(every).all(axis=1)]
    middle, widest = 0.5 * (every.min(axis=0) + every.max(axis=0)), np.ptp(every, axis=0).max()
    for index, ends in enumerate((axes.get_xlim(), axes.get_ylim(), axes.get_zlim())):
        assert np.mean(ends) == pytest.approx(middle[index])
        assert np.ptp(ends) == pytest.approx(1.1 * widest, rel=0.1)


def test_names_are_shown_to_the_letter(tmp_path: Path) -> None:
    rollout = compared(**{name: made_up(chain(4, joints=list(HOSTILE))) for name in HOSTILE})
    figure = plots.overview(rollout)
    plots.save(figure, tmp_path / "a.svg")  # no mathematics fails, no glyph is missing
    shown = [text.get_text() for text in figure.legends[0].get_texts()]
    assert (
        len(
            [label for label in shown if any(label.strip()[:6] == plots.text(n).strip()[:6] for n in HOSTILE)]
        )
        == 4
    )


@settings(max_examples=50)
@given(st.text(max_size=80))
def test_any_text_is_a_label(name: str) -> None:
    shown = plots.text(name)
    assert len(shown.replace("\\$", "$")) <= style.LONGEST + 1
    assert not shown.startswith("_")


@pytest.mark.slow
def test_what_cannot_be_drawn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RolloutError, match="no samples"):
        plots.overview(ONE.isel(time=slice(0)))
    with pytest.raises(NameNotFound, match="q4"):
        plots.overview(ONE, ["q4"])
    with pytest.raises(ParameterError, match=r"\.png"):
        plots.save(plots.errors(ONE), tmp_path / "a.gif")
    with pytest.raises(RolloutError, match="cannot be written"):
        plots.save(plots.errors(ONE), tmp_path / "none" / "a.png")
    assert plots.overview(ONE.isel(time=slice(1)))  # a single sample is drawn
    assert plots.disturbances(ONE.drop_vars("disturbance"))


#: What people without one kind of cone see, of linear sRGB (Machado, Oliveira and Fernandes, 2009,
#: doi:10.1109/TVCG.2009.113, severity 1), and what grey paper shows (Rec. 709).
SEEN = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
    "grey": [[0.2126, 0.7152, 0.0722]] * 3,
}
#: Of linear sRGB to CIE XYZ (IEC 61966-2-1).
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
)


def linear(color: str) -> np.ndarray:
    """A colour as linear sRGB."""
    each = np.array([int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    return np.where(each <= 0.04045, each / 12.92, ((each + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """A colour in CIE L*a*b*, in which a distance of 2.3 is just seen."""
    t = XYZ @ np.clip(rgb, 0.0, 1.0) / XYZ.sum(axis=1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("kind", SEEN)
def test_controllers_are_told_apart_without_some_colours(kind: str) -> None:
    """By their dashes, or by six times what is just seen."""
    own = dict(zip(style._OWN, style.looks(style._OWN), strict=True))
    seen = {name: lab(np.array(SEEN[kind]) @ linear(look.color)) for name, look in own.items()}
    for one, other in itertools.combinations(own, 2):
        apart = np.linalg.norm(seen[one] - seen[other])
        assert own[one].dashes != own[other].dashes or apart > 14.0, (one, other)


def test_controllers_that_are_compared_the_most_are_seen_on_white() -> None:
    for each in style.looks(["gpi", "pid", "network", "gpi_auto"]):
        luminance = float(np.array([0.2126, 0.7152, 0.0722]) @ linear(each.color))
        assert 1.05 / (luminance + 0.05) >= 3.0  # WCAG 2.2, 1.4.11


def test_colours_can_be_told_apart() -> None:
    # Okabe and Ito's palette; its relative luminances differ, so that it also works in grey.
    assert len({style.look(i) for i in range(28)}) == 28


def test_a_torque_that_jumps_between_its_limits_is_marked_at_each_by_itself() -> None:
    effort = ONE["effort"].values
    signs = np.where(np.arange(ONE.sizes["time"]) % 2, 1.0, -1.0)
    jumping = ONE.assign(tau=ONE["tau"].copy(data=signs[:, np.newaxis] * effort))
    figure = plots.torques(jumping, joints=["q2"])
    marked = [one for one in figure.axes[0].get_lines() if one.get_label() == "at the limit"]
    for one, sign in zip(marked, (-1.0, 1.0), strict=True):
        values = np.asarray(one.get_ydata())
        assert set(values[np.isfinite(values)]) == {sign * effort[1]}


def test_the_note_on_a_limit_is_clear_of_a_long_name() -> None:
    name = "a_very_long_joint_name_from_a_cad_assembly_left_arm_v2_final_1"
    figure = plots.torques(ONE.assign_coords(joint=[name, "$x_1$", "c"]))
    assert any("limit" in text.get_text() for axes in figure.axes for text in axes.texts)
    assert texts_overlap(figure) == []


def test_figures_are_drawn_into_axes_of_ones_own() -> None:
    figure = Figure()
    axes = figure.subplots(3)
    assert plots.errors(ONE, ax=axes) is figure
    assert plots.torques(ONE, ["q1"], ax=axes[0]) is figure
    np.testing.assert_array_equal(axes[1].lines[1].get_ydata(), (ONE["q"] - ONE["q_ref"]).sel(joint="q2"))
    with pytest.raises(ParameterError, match="axes for each of q1, q2, q3"):
        plots.errors(ONE, ax=axes[:2])


def test_a_legend_has_as_many_columns_as_its_letters_leave() -> None:
    with plots.styled():
        figure, axes = plots.panels(1)
        figure.set_figwidth(6.4)
        for name in "abcdefgh":
            axes[0, 0].plot([0.0], [0.0], label=10 * name)
        plots.legend(figure)
    # A letter is 0.06 in wide, and a line with what is around it half an inch.
    found: Any = figure.legends[0]
    assert found._ncols == int(6.4 / 1.1)


def test_neighbours_differ_in_colour_and_in_dashes() -> None:
    several = [style.look(index) for index in range(60)]
    for one, other in itertools.pairwise(several):
        assert one.color != other.color
        assert one.dashes != other.dashes
    # A colour comes again with other dashes, as often as there are any.
    for index in range(len(style.PALETTE)):
        same = several[index :: len(style.PALETTE)][: len(style._DASHES)]
        assert len({str(each.dashes) for each in same}) == len(same)
