"""Pages that hold everything they need: one HTML file with its text, and the viewer, the motion and the data.

What a page shows is JSON and arrays. Text from files gets into it in two ways only: as JSON, in which no
character can end the element that holds it, and as HTML, escaped. A content security policy in the page lets
it run its own scripts, by their hashes, and fetch nothing at all.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from importlib import resources
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt

from armgpi.base.escape import html_text, printable
from armgpi.loop.provenance import versions
from armgpi.loop.units import POSITION, TORQUE
from armgpi.viewing.meshes import Triangles
from armgpi.viewing.scene import Clip, Scene

#: NumPy's types and their names in the page.
_TYPES = {"float32": "f32", "float64": "f64", "int8": "i8", "uint8": "u8", "uint16": "u16", "uint32": "u32"}
#: Joints without limits get sliders over this range [rad or m].
_UNLIMITED = math.pi

#: Distance of arms side by side, as a share of how far both reach.
_ROOM = 0.55

#: Text as HTML that shows it to the letter.
text = html_text


class Page(str):
    """The text of a page; a notebook shows the page."""

    def __repr__(self) -> str:
        """Return a line, not the text, which has megabytes."""
        return f"<page of {len(self):,} characters: a notebook shows it, and armgpi.view writes it to a file>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self)}" style="width: 100%; height: 40rem; border: 0"></iframe>'


class Arrays:
    """Arrays of a page: packed into one block, each once, referred to from the JSON."""

    def __init__(self) -> None:
        """Begin without arrays."""
        self._offsets: dict[bytes, int] = {}
        self._length = 0

    def add(self, array: npt.ArrayLike, dtype: str) -> dict[str, Any]:
        """Take an array in and return what the JSON says of it."""
        values = np.ascontiguousarray(array, dtype=np.dtype(dtype).newbyteorder("<"))
        content = values.tobytes()
        content += b"\0" * (-len(content) % 8)
        offset = self._offsets.setdefault(content, self._length)
        self._length = max(self._length, offset + len(content))
        return {"type": _TYPES[dtype], "offset": offset, "length": int(values.size)}

    def text(self) -> str:
        """Return all arrays, compressed, as text; the same arrays make the same text."""
        return base64.b64encode(gzip.compress(b"".join(self._offsets), 6, mtime=0)).decode()


def arm_data(scene: Scene, arrays: Arrays) -> dict[str, Any]:
    """Return what the page knows of an arm."""
    robot = scene.robot
    limits, prismatic = robot.limits, robot.prismatic.tolist()
    joints = []
    for j, name in enumerate(robot.joint_names):
        bounded = math.isfinite(limits.lower[j]) and math.isfinite(limits.upper[j])
        bounded = bounded and limits.upper[j] - limits.lower[j] < 1e3
        effort = float(limits.effort[j])
        joints.append(
            {
                "name": name,
                "effort": effort if math.isfinite(effort) and effort < 1e300 else 0.0,
                "lower": float(limits.lower[j]) if bounded else -_UNLIMITED,
                "upper": float(limits.upper[j]) if bounded else _UNLIMITED,
                "unit": POSITION.symbol(prismatic[j]),
                "torque_unit": TORQUE.symbol(prismatic[j]),
            }
        )
    bodies = [
        {
            "coordinate": body.coordinate,
            "ratio": body.ratio,
            "offset": body.offset,
            "parent": body.parent,
            "kind": body.kind,
            "placement": _columns(body.placement),
            "axis": body.axis.tolist(),
            "ring": body.ring,
            "fine": _mesh_data(body.triangles, arrays),
            "coarse": _mesh_data(body.coarse, arrays),
        }
        for body in scene.bodies
    ]
    return {
        "name": robot.name,
        "joints": joints,
        "bodies": bodies,
        "tip": {"body": scene.tip_body, "placement": _columns(scene.tip)},
        "size": scene.size,
        "configuration": robot.middle().tolist(),
    }


def beside(scenes: Sequence[Scene], arrays: Arrays) -> dict[str, Any]:
    """Return what the page knows of several arms side by side: one tree, with a base for each."""
    whole = arm_data(scenes[0], arrays)
    many, y = len(scenes) > 1, 0.0
    for k, scene in enumerate(scenes):
        arm = arm_data(scene, arrays) if k else whole
        if many:
            for joint in arm["joints"]:
                joint["name"] = f"{scene.robot.name}: {joint['name']}"
        if not k:
            continue
        bodies, joints = len(whole["bodies"]), len(whole["joints"])
        y += _ROOM * (scenes[k - 1].size + scene.size)
        for i, body in enumerate(arm["bodies"]):
            body["coordinate"] += joints
            body["parent"] = body["parent"] + bodies if i else 0
        arm["bodies"][0]["placement"][13] += y  # column by column: the 14th is along y
        for key in ("bodies", "joints", "configuration"):
            whole[key] += arm[key]
        whole["size"] = max(whole["size"], arm["size"])
    return whole


def clip_data(clip: Clip, arrays: Arrays) -> dict[str, Any]:
    """Return what the page knows of a motion."""
    return {
        "times": arrays.add(clip.times, "float32"),
        "disturbance": arrays.add(clip.disturbance, "float32"),
        "onsets": clip.onsets,
        "walls": [wall._asdict() for wall in clip.walls],
        "actors": [
            {
                "label": actor.label,
                "color": actor.color,
                "end": actor.end,
                "t_end": actor.t_end,
                "q": arrays.add(actor.q, "float32"),
                "q_ref": arrays.add(actor.q_ref, "float32"),
                "tau": arrays.add(actor.tau, "float32"),
                "saturated": arrays.add(actor.saturated, "uint8"),
                "contacts": actor.forces.shape[1],
                "forces": arrays.add(actor.forces, "float32"),
                "points": arrays.add(actor.points, "float32"),
            }
            for actor in clip.actors
        ],
    }


def fill(
    template: str,
    values: Mapping[str, str],
    data: Any = None,
    arrays: Arrays | None = None,
    scripts: Sequence[str] = (),
    computes: bool = False,
) -> Page:
    """Return a page made from a template.

    Args:
        template: name of its file.
        values: HTML for the template's other places.
        data: what becomes the page's JSON.
        arrays: what the JSON refers to.
        scripts: JavaScript, in its order.
        computes: whether it runs WebAssembly that it holds, in a worker.
    """
    safe = [script.replace("</script", "<\\/script").replace("<!--", "<\\!--") for script in scripts]
    runs = " 'wasm-unsafe-eval'; worker-src blob:" if computes else ""
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in safe)
    hashes = " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'"
    places = {
        # What a page may do: its own scripts and styles, pictures within it, and nothing else. 'self' is the
        # server that a live page came from; a file has none.
        "policy": f"default-src 'none'; script-src {hashes}{runs}; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'",
        "style": asset("page.css"),
        "data": json_text(data),
        "arrays": "" if arrays is None else arrays.text(),
        "footer": f"Made by armgpi {text(versions()['armgpi'])}. This file needs no network.",
        "scripts": "\n".join(f"<script>{script}</script>" for script in safe),
        **values,
    }
    parts = asset(template).split("{{")
    filled = [parts[0]]
    for part in parts[1:]:
        name, rest = part.split("}}", 1)
        filled += [places[name], rest]
    return Page("".join(filled))


def json_text(data: Any) -> str:
    """Return data as JSON in which nothing can end the element around it; its text is as shown."""
    text = json.dumps(_printable_data(data), allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def document(title: str, summary: str, sections: Mapping[str, str]) -> Page:
    """Return a page of text alone, without scripts.

    Args:
        title: plain text.
        summary: HTML under the title.
        sections: heading, plain text -> content, HTML.
    """
    parts = (f"<section><h2>{text(heading)}</h2>{content}</section>" for heading, content in sections.items())
    return fill("document.html", {"title": text(title), "summary": summary, "sections": "\n".join(parts)})


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    label: str,
    names: int = 1,
    classes: Sequence[str] = (),
    words: Sequence[int] = (),
    marks: Sequence[str] = (),
) -> str:
    """Return an HTML table of plain text, which scrolls sideways where it is too wide.

    Args:
        head: headings; a line break stays one.
        rows: the cells.
        label: what it shows, for those who cannot see it.
        names: how many columns at the left name the row.
        classes: CSS class of each row; none when not given.
        words: indices of the other columns that are not numbers.
        marks: colour of the dot before the first cell of each row, empty for none.
    """
    left = {*range(names), *words}
    headings = "".join(
        f"<th scope=col{' class=name' if k in left else ''}>{text(title)}</th>"
        for k, title in enumerate(head)
    ).replace("\n", "<br>")
    lines = []
    for row, kind, color in zip_longest(rows, classes, marks, fillvalue=""):
        dots = [f"{dot(color)} " if color else "", *[""] * names]
        cells = [
            f"<th scope=row class=name title='{text(cell)}'>{mark}{text(cell)}</th>"
            for mark, cell in zip(dots, row[:names], strict=False)
        ]
        cells += [
            f"<td{' class=words' if k in words else ''}>{text(cell)}</td>"
            for k, cell in enumerate(row[names:], start=names)
        ]
        lines.append(f"<tr{f' class={kind}' if kind else ''}>{''.join(cells)}</tr>")
    return (
        f"<div class=scroll tabindex=0 role=region aria-label='{text(label)}'><table class=data>"
        f"<thead><tr>{headings}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>"
    )


def from_markdown(markdown: str, label: str) -> str:
    """Return paragraphs, headings and tables of Markdown as HTML; all else of it is plain text.

    Args:
        markdown: the text.
        label: what its tables show, for those who cannot see them.
    """
    parts = []
    for block in filter(None, (block.strip() for block in markdown.split("\n\n"))):
        lines = block.splitlines()
        if lines[0].startswith("|") and len(lines) > 1:
            head, _, *rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in lines]
            head = [cell.replace(" [", "\n[").replace(", ", ",\n", 1) for cell in head]
            parts.append(table(head, rows, label=label))
        elif lines[0].startswith("#"):
            parts.append(f"<h3>{text(block.lstrip('# '))}</h3>")
        else:
            parts.append(f"<p>{text(block)}</p>")
    return "".join(parts)


def picture(content: bytes, words: str) -> str:
    """Return a PNG as HTML, with what it shows for those who cannot see it."""
    data = base64.b64encode(content).decode()
    return (
        f'<div class=scroll><img class=picture alt="{text(words)}" src="data:image/png;base64,{data}"></div>'
    )


def dot(color: str) -> str:
    """Return the mark of a rollout, in its colour."""
    return f"<span class=dot style='background:{text(color)}'></span>"


def fold(title: str, content: str) -> str:
    """Return HTML that shows when its title, plain text, is asked for."""
    return f"<details><summary>{text(title)}</summary>{content}</details>"


def bullets(items: Iterable[object], kind: str = "") -> str:
    """Return an HTML list of plain text with a CSS class; nothing when there are no items."""
    entries = "".join(f"<li>{text(item)}</li>" for item in items)
    return f"<ul{f' class={kind}' if kind else ''}>{entries}</ul>" if entries else ""


@lru_cache(maxsize=8)
def asset(name: str) -> str:
    """Return a file of the folder ``page``."""
    return (resources.files("armgpi.viewing") / "page" / name).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def meshcat_script() -> str:
    """Return MeshCat's viewer, as its package has it, after its licence."""
    folder = resources.files("armgpi.viewing") / "page" / "meshcat"
    licence = (folder / "LICENSE").read_text(encoding="utf-8")
    viewer = gzip.decompress((folder / "main.min.js.gz").read_bytes()).decode()
    return f"/*! MeshCat\n{licence}*/\n{viewer}"


def _mesh_data(triangles: Triangles, arrays: Arrays) -> dict[str, Any]:
    """Return what the page knows of triangles."""
    points, normals, colors, faces = triangles
    return {
        "points": arrays.add(points, "float32"),
        "normals": arrays.add(np.rint(normals * 127.0), "int8"),
        "colors": arrays.add(np.rint(np.clip(colors, 0.0, 1.0) * 255.0), "uint8"),
        "faces": arrays.add(faces, "uint16" if len(points) < 65536 else "uint32"),
    }


def _printable_data(data: Any) -> Any:
    """Return plain data with its text as it may be shown."""
    if isinstance(data, str):
        return printable(data, lines=True)
    if isinstance(data, Mapping):
        return {key: _printable_data(value) for key, value in data.items()}
    return [_printable_data(value) for value in data] if isinstance(data, list | tuple) else data


def _columns(matrix: npt.NDArray[np.float64]) -> list[float]:
    """Return a matrix column by column, as three.js has it."""
    columns: list[float] = matrix.T.ravel().tolist()
    return columns
