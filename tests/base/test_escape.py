"""Nothing from a file reaches the terminal or a page raw."""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
import tempfile
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from armgpi.base.escape import counted, in_si, printable
from armgpi.cli import main
from armgpi.viewing.page import text as in_html

#: What commands a terminal, hides, or turns other text around; a few that are known for it.
FAMOUS = "\x1b\x07\r\n\x00\x7f\x85\x9b\xad\u061c\u200b\u200e\u202e\u2028\u2029\u2066\ufeff\U000e0041\udcff"
nasty = st.text(st.one_of(st.sampled_from(FAMOUS), st.characters()), min_size=1, max_size=8)


def forbidden(text: str) -> list[str]:
    """Return the characters that must not be shown."""
    return [c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")]


def said(*arguments: object) -> str:
    """Return what `armgpi` prints, on both streams, without our own ends of lines."""
    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(sys, "argv", ["armgpi", *map(str, arguments)])
        with contextlib.suppress(SystemExit):
            main()
    text = out.getvalue() + err.getvalue()
    assert text
    assert "Traceback" not in text
    return text.replace("\n", "")


def urdf(robot: str, joint: str) -> str:
    """Return an arm whose names are these, as character references."""

    def name(text: str) -> str:
        return "".join(f"&#{ord(c)};" if not c.isalnum() else c for c in text)

    robot, joint = name(robot), name(joint)
    return (
        f'<robot name="r{robot}"><link name="a"/><link name="b"><inertial><mass value="1"/>'
        '<origin xyz="0.1 0 0"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<visual><geometry><mesh filename="m{robot}.stl"/></geometry></visual></link>'
        f'<joint name="j{joint}" type="revolute"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="99" velocity="3"/></joint></robot>'
    )


#: What a reference of XML 1.0 may name.
xml = st.text(
    st.one_of(
        st.sampled_from([c for c in FAMOUS if c in "\r\n" or (c >= "\x7f" and c != "\udcff")]),
        st.characters(min_codepoint=0x20, max_codepoint=0xD7FF),
    ),
    min_size=1,
    max_size=6,
)


@given(nasty)
@example(FAMOUS)
def test_what_is_shown_is_printable_and_says_what_it_was(text: str) -> None:
    assert printable(text).isprintable()
    assert forbidden(printable(text, lines=True).replace("\n", "")) == []
    assert forbidden(in_html(text).replace("\n", "")) == []
    if "\\" not in text:
        assert printable(text).encode("ascii", "backslashreplace").decode("unicode_escape") == text


def test_one_thing_is_named_in_the_singular() -> None:
    said = [counted(count, "rollout") for count in (0, 1, 2)]
    assert said == ["0 rollouts", "1 rollout", "2 rollouts"]
    assert counted(2, "axis", "axes") == "2 axes"


def test_ordinary_text_is_shown_as_it_is() -> None:
    for text in ("q1", "Gelenk äöü", "関節", "rad s²", "\\alpha", "a b", ""):
        assert printable(text) == text
    assert printable("a\nb") == "a\\nb"
    assert printable("a\nb", lines=True) == "a\nb"
    assert in_html("<a> & \x1b\n") == "&lt;a&gt; &amp; \\x1b\n"


@settings(max_examples=4)
@given(nasty, xml, xml)
@example("\x1b[31m", "\x9b31m", "\u202egnp")
@example("a\nerror: forged", "a\nerror: forged", "\u2028")
def test_names_of_controllers_robots_and_joints_in_tables(label: str, robot: str, joint: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "arm.urdf")
        path.write_text(urdf(robot, joint), encoding="utf-8")
        config = Path(name, "experiment.yaml")
        sections = [{"type": "gpi", "label": each} for each in (label, "other")]
        data = {"robot": {"name": str(path)}, "controllers": sections, "t_final": 0.002}
        config.write_text(yaml.safe_dump(data), encoding="utf-8")
        for arguments in (
            ("compare", "--config", config),
            ("run", path, "--t-final", 0.002),
            ("run", path, "--t-final", 0.002, "--to", "nothing=1"),
            ("inspect", path),
            ("derive", path),
        ):
            text = said(*arguments)
            assert forbidden(text) == []
            assert "error: forged" not in text.replace("\\nerror: forged", "")


@settings(max_examples=10)
@given(nasty.filter(lambda text: "\0" not in text))
@example("\x1b[31m")
@example("a\nerror: forged")
def test_names_of_files_and_options_in_errors(name: str) -> None:
    for arguments in (
        ("inspect", f"{name}.urdf"),
        ("run", "anthropomorphic3", "--config", f"none/{name}.yaml"),
        ("run", "anthropomorphic3", f"--{name}"),
        ("run", "anthropomorphic3", "--controller", name),
        ("report", f"none/{name}.nc"),
        (f"x{name}",),
    ):
        text = said(*arguments)
        assert forbidden(text) == []


@settings(max_examples=10)
@given(nasty)
@example("\x1b[31m")
def test_what_stands_in_an_experiment_file_is_shown_in_its_error(key: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        path, quoted = Path(name, "experiment.yaml"), yaml.safe_dump(key, width=1000).partition("\n")[0]
        for text in (
            f"robot: {{name: anthropomorphic3}}\n{quoted}: 1\n",
            f"robot: {{name: {quoted}}}\n",
            f"robot: {{name: anthropomorphic3}}\nt_final: {quoted}\n",
            f"robot: [{key}",
        ):
            path.write_bytes(text.encode("utf-8", "surrogatepass"))
            assert forbidden(said("run", "--config", path, "--t-final", "0.002")) == []


def texts(data: Any) -> Iterator[str]:
    """Give all text in plain data."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict | list):
        for each in data.values() if isinstance(data, dict) else data:
            yield from texts(each)


@settings(max_examples=3)
@given(xml)
@example("\x9b31m\u202egnp")
def test_names_in_pages(robot: str) -> None:
    pytest.importorskip("meshcat")
    from armgpi import Robot
    from armgpi.viewing import meshcat

    def raw(page: str) -> tuple[list[str], list[str]]:
        """Return what must not be shown, in the page and in its JSON."""
        found = re.search(r'type="application/json">(.*?)</script>', page, re.S)
        assert found
        return forbidden(page.replace("\n", "")), forbidden("".join(texts(json.loads(found[1]))))

    plain = raw(meshcat.robot_page(Robot.from_xml(urdf("", ""))))
    assert raw(meshcat.robot_page(Robot.from_xml(urdf(robot, "")))) == plain


@pytest.mark.parametrize("module", sorted((Path(__file__).parents[2] / "armgpi" / "cli").glob("*.py")))
def test_commands_print_through_the_terminal_alone(module: Path) -> None:
    """There is one way out, or one of them is forgotten."""
    text = module.read_text(encoding="utf-8")
    if module.name != "terminal.py":
        assert not re.search(r"typer\.s?echo|(?<![.\w])print\(|\bConsole\(|sys\.std(out|err)\.write", text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("30deg", "write 0.523599 (rad)"),
        (" -30 ° ", "write -0.523599 (rad)"),
        ("1ms", "write 0.001 (s)"),
        ("1.5e1 cm", "write 0.15 (m)"),
        ("0.1 kg m^2", "write 0.1 (kg m^2)"),
        ("500g", "write 0.5 (kg)"),
        ("60 rpm", "write 6.28319 (rad/s)"),
        ("5%", "write 0.05 (as a share)"),
        ("30", ""),
        ("nan", ""),
        ("1e5", ""),
        ("3 apples", ""),
        ("deg", ""),
        (None, ""),
        ("9" * 5000 + "m", ""),
    ],
)
def test_a_number_with_a_unit_is_told_in_si(text: object, said: str) -> None:
    assert in_si(text).strip() == said
