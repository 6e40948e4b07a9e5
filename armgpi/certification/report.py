"""The page of a certificate: what is claimed, the numbers, Nyquist's curve, the box, and the worst found."""

from __future__ import annotations

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.verdict import Verdict
from armgpi.certification.adversary import worst
from armgpi.certification.certificate import Certificate
from armgpi.certification.quantities import functions, points, ranges
from armgpi.certification.request import Asked, member_of
from armgpi.certification.text import NUMBERS, OTHERS, STATUS, claims, shares, table, verdict
from armgpi.gpi.advice import COUNT_SHARE
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import open_loop
from armgpi.loop.units import POSITION, TORQUE
from armgpi.viewing import page, style
from armgpi.viewing.drawing import LINE, Drawing, figure

#: What of the plane Nyquist's curve is drawn in.
_REACH = 2.2
#: Configurations that are drawn for the share of each number along a joint, and its parts.
_DRAWN, _PARTS = 3000, 24
_BLUE, _GREEN, _PURPLE, _ORANGE = (style.PALETTE[place] for place in (0, 2, 3, 4))
_COLOURS = {"delta_high": _BLUE, "sigma": _ORANGE, "kappa_v": _GREEN, "kappa_e": _PURPLE}
#: How each is drawn, for who cannot tell colours.
_DASHES = {
    "delta_high": ("", "solid"),
    "sigma": ("7 3", "dashed"),
    "kappa_v": ("2 2", "dotted"),
    "kappa_e": ("7 2 2 2", "dash-dotted"),
}
_QUIET = "#aeb8c2"


def html(asked: Asked, made: Certificate, judged: Verdict | None = None) -> str:
    """Return the page, without scripts and without anything from elsewhere.

    Args:
        asked: what was asked for.
        made: the certificate, or why there is none.
        judged: the verdict, where something that was asked for was left out.
    """
    sections = {}
    if made.reasons:
        sections["What limits the certificate, and what to change"] = page.bullets(made.reasons)
    if made.data["solutions"]:
        heading = "What is certified" if made.certified else "Bounds that hold, less than was asked for"
        sections[heading] = _claims(asked, made)
    sections["Numbers of the arm"] = _numbers(made)
    sections["Nyquist's curve and the circle"] = _nyquist(made)
    sections["How much of each number the configurations need"] = _box(asked, made)
    disturbing = made.data["shares"].items()
    shares = [(name, f"{value:.3g}") for name, value in disturbing if value]
    if shares:
        head = ("disturbance", "length in the metric of D")
        sections["Disturbances"] = page.table(head, shares, label="disturbances")
    sections["What it assumes"] = page.bullets(made.data["assumptions"])
    useful, what_for = _worth(asked, made)
    kind = "good" if useful else "bad"
    said = verdict(made)
    if judged is not None and judged.outcome == "holds for part":
        kind, said = "fair" if useful else "bad", judged.line
    of = table(made)[1 + len(made.reasons)]
    summary = f"<p>{page.text(of)}</p><p class={kind}>{page.text(said + what_for)}</p>"
    heading = "Certificate" if made.certified else "No certificate"
    return page.document(f"{heading} of {made.data['robot']['name']}", summary, sections)


def _worth(asked: Asked, made: Certificate) -> tuple[bool, str]:
    """Return whether a certificate holds for disturbances that matter, and in words for which it does."""
    if not made.certified or "gain" not in made.data["inputs"]:
        return made.certified, ""
    most = float(made.data["inputs"]["gain"]["torque"])
    inverse = [float(text) for text in made.data["numbers"]["inverse"]]
    borne = most / np.sqrt(inverse)
    share = borne / asked.robot.limits.effort
    j = int(np.argmin(share))
    if not 0.0 < share[j] < np.inf:
        return True, ""
    unit = TORQUE.symbol(bool(asked.robot.prismatic[j]))
    percent = f"{100.0 * share[j]:.2g} % of its effort"
    said = f"; it tolerates {borne[j]:.2g} {unit} at {made.joint_names[j]}, {percent}"
    useful = bool(share[j] >= COUNT_SHARE)  # what one encoder count alone may move
    return (
        useful,
        said if useful else f"{said}: less than static friction; a smaller box or speed increases it",
    )


def _claims(asked: Asked, made: Certificate) -> str:
    """Return the claims for each joint, beside the worst that an adversary found."""
    cases = worst(asked, count=40)
    claimed = zip(made.joint_names, claims(made), made.per_torque, strict=True)
    rows = []
    for (name, (gain, *others), certified), case in zip(claimed, cases, strict=True):
        ratio = certified / case.error
        rows.append([name, gain, f"{case.error:.3g}", f"{ratio:.2f}", *others])
    head = [
        "joint",
        "error per torque\nat rest, certified",
        "worst found",
        "ratio",
        "for torques\nup to",
        "error under\nall stated",
        "from a start",
        "after a jump\nof the load",
        "torque\nneeded",
    ]
    inputs = shares(made)
    said = (
        "The worst found is that of a torque which switches at the worst times, at 40 configurations and "
        f"both loads. Their effect decays at {made.decay:.3g} "
        f"1/s.{f' Shares of the disturbances: {inputs}.' if inputs else ''}"
    )
    return page.table(head, rows, label="claims for each joint") + f"<p>{page.text(said)}</p>"


def _numbers(made: Certificate) -> str:
    """Return the numbers with their status."""
    numbers = made.data["numbers"]
    rows = []
    described = NUMBERS | OTHERS
    for name, (what, unit) in described.items():
        if name not in numbers:
            continue
        value = numbers[name]
        of_joints = value if isinstance(value, list) else [value]
        largest = max(map(float, of_joints))
        status = STATUS[made.data["status"][name]]
        if largest:
            rows.append((name, f"{largest:.4g}", unit, status, what))
    head = ("number", "value", "unit", "status", "what it is")
    return page.table(head, rows, label="numbers", words=(2, 3, 4))


def _nyquist(made: Certificate) -> str:
    """Return L(j w - sigma / 2) with the circle that it may not enter."""
    law, numbers = made.data["law"], made.data["numbers"]
    low = float(numbers["delta_low"])
    high = float(numbers["delta_high"])
    sigma = float(numbers["sigma"])
    omega = float(law["omega"][0])
    zeta = float(law["zeta"])
    pole = float(law["pole_ratio"]) * omega
    tuning = Tuning(np.array(omega), np.array(zeta), np.array(pole))
    loop = open_loop(tuning, member_of(law))
    # In units of omega, as the open loop is.
    s = 1j * np.geomspace(1e-2, 1e3, 4000) - 0.5 * sigma / omega
    denominator = np.polyval(loop.denominator, s)
    curve = np.polyval(loop.numerator, s) / denominator
    near = np.abs(curve) < 2.0 * _REACH
    drawing = Drawing((-_REACH, 0.6), (-1.0, 1.0))
    parts = [
        drawing.line([(-_REACH, 0.0), (0.6, 0.0)], _QUIET),
        drawing.line([(0.0, -1.0), (0.0, 1.0)], _QUIET),
        drawing.text(0.5, 0.04, "Re"),
        drawing.text(0.1, 0.92, "Im"),
    ]
    centre = -0.5 * (1.0 / low + 1.0 / high)
    radius = 0.5 * (1.0 / low - 1.0 / high)
    turns = np.linspace(0.0, 1.0, 121)
    circle = centre + radius * np.exp(2j * np.pi * turns)
    round_it = list(zip(circle.real, circle.imag, strict=True))
    parts.append(drawing.line(round_it, style.ALARM, fill="#f4d5d8"))
    for sign in (1.0, -1.0):
        shown = curve[near]
        path = list(zip(shown.real, sign * shown.imag, strict=True))
        parts.append(drawing.line(path, _BLUE))
    ends = {f"-1/{low:.3g}": -1.0 / low, f"-1/{high:.3g}": -1.0 / high}
    for text, x in ends.items():
        beside = 0.2 if x > -1.0 / low else -0.2
        parts.append(drawing.text(x + beside, -0.1, text, colour=LINE))
    said = (
        f"L(jω - σ/2) of a joint with σ = {sigma:.3g} 1/s, and the circle of δ from {low:.3g} to {high:.3g}. "
        "That the curve stays outside the circle is necessary while the arm moves at the stated speed; "
        "sampling, delay, gravity and Coriolis torques require more."
    )
    return figure(drawing.svg(parts, said), said)


def _shares_taken(asked: Asked, made: Certificate, drawn: Array) -> dict[str, Array]:
    """Return how much of each number of a certificate configurations take: 1 is the number itself.

    Args:
        asked: what the certificate is of.
        made: the certificate.
        drawn: configurations as shares of the ranges, (k, 3 n).

    Returns:
        Name of a number -> shares (k,), each of the worst arm; zero where the number is at its best value.
    """
    setting = asked.setting
    lowest, width = ranges(setting)
    at = points(setting, lowest + width * drawn)
    every = functions(setting)
    shares = {}
    for name in _COLOURS:
        best = 1.0 if name == "delta_high" else 0.0  # delta is the ratio 1 for an exact model
        function = every[name]
        of_arms = [function(setting, arm, at) for arm in setting.arms]
        values = np.max(of_arms, axis=0)
        room = float(made.data["numbers"][name]) - best
        shares[name] = (values - best) / room if room > 1e-9 else np.zeros(len(drawn))
    return shares


def _box(asked: Asked, made: Certificate) -> str:
    """Return the largest share of each number along each joint of the box."""
    setting = asked.setting
    rng = np.random.default_rng(0)
    drawn = rng.random((_DRAWN, 3 * asked.robot.n))
    shares = _shares_taken(asked, made, drawn)
    figures = []
    for j, joint in enumerate(asked.robot.joint_names):
        low, high = setting.lower[j], setting.upper[j]
        if not high > low:
            continue
        drawing = Drawing((low, high), (0.0, 1.05), height=150)
        place = (_PARTS * drawn[:, j]).astype(int)
        ends_and_middles = np.linspace(low, high, 2 * _PARTS + 1)
        middles = ends_and_middles[1::2]
        levels = [[(low, y), (high, y)] for y in (0.0, 0.5, 1.0)]
        parts = [drawing.line(level, _QUIET) for level in levels]
        for y in (0.5, 1.0):
            parts += [drawing.text(low, y - 0.09, f"{y:g}", "start")]
        for name, colour in _COLOURS.items():
            share = shares[name]
            largest = [share[place == k].max(initial=0.0) for k in range(_PARTS)]
            dash, _ = _DASHES[name]
            path = list(zip(middles, largest, strict=True))
            parts.append(drawing.line(path, colour, dash=dash))
        unit = POSITION.symbol(asked.robot.prismatic[j])
        said = f"{joint}: {low:.3g} to {high:.3g} {unit}"
        figures.append(figure(drawing.svg(parts, said), said))
    legend = ", ".join(
        f"<b><font color='{colour}'>{name}</font></b> ({_DASHES[name][1]})"
        for name, colour in _COLOURS.items()
    )
    said = (
        f"<p>Largest share of {legend} at configurations with this joint there; 1 is what the certificate "
        "assumes, so the distance below 1 is the margin. A smaller box helps where curves are low.</p>"
    )
    return said + f"<div class=figures>{''.join(figures)}</div>"
