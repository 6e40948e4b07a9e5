"""Sphinx configuration. Build with `make docs`; no network is used."""

import ast as _ast
import re as _re
from dataclasses import replace as _replace
from importlib.resources import files as _files
from pathlib import Path as _FilePath

from armgpi.base.parameter import REQUIRED as _REQUIRED
from armgpi.base.parameter import parameters as _parameters
from armgpi.base.version import VERSION as _VERSION
from armgpi.cli import declared as _declared
from armgpi.config.schema import KINDS as _KINDS
from armgpi.hardware.export import interfaces as _interfaces
from armgpi.health import findings as _findings
from armgpi.health import report as _report  # noqa: F401  # registers the checks
from armgpi.loop import metrics as _metrics
from armgpi.plants.arm import Arm as _Arm
from armgpi.plants.environment import Contact as _Contact
from armgpi.plants.loads import Load as _Load
from armgpi.plants.plant import Wrapper as _Wrapper
from armgpi.plants.reality import Reality as _Reality
from armgpi.references.paths import Path as _Path
from armgpi.registry import classes_of as _all_registered
from armgpi.robot import known_arms as _known_arms
from armgpi.supervisor import Supervisor as _Supervisor
from armgpi.supervisor import reasons as _reasons

project = "armgpi"
author = "The armgpi developers"
project_copyright = author
release = version = _VERSION

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",  # each name of the reference links to its source
]
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "substitution"]
# Pages to play with, where `make playground` made some: too large to be kept.
_playground = _FilePath(__file__).parents[1] / "build" / "playground"
html_extra_path = [str(_playground)] if _playground.is_dir() else []
myst_heading_anchors = 4  # lets pages link to each other's headings


def metrics_table():
    """Return the metrics as a Markdown table, from their declarations."""
    rows = [("column", "name in files", "meaning", "unit", "shown in"), ("---",) * 5]
    for name, metric in _metrics.declared().items():
        meaning = metric.function.__doc__.partition("\n\n")[0].removeprefix("Return ").rstrip(".")
        row = (metric.heading, f"`{name}`", meaning, str(metric.unit) or "–", ", ".join(metric.tables))
        rows.append(tuple(cell.replace("|", "\\|").replace("``", "`") or "files alone" for cell in row))
    return _table(rows)


def _table(rows):
    """Return rows of cells as Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _row(key, each):
    """Return what is to be known of a declared parameter: key, meaning, values, default."""
    values = {
        "choice": ", ".join(f"`{choice}`" for choice in each.choices),
        "flag": "`true`, `false`",
        "text": "text",
        "vector": "three numbers",
        "numbers": "a list of numbers",
        "range": f"`[lowest, highest]`, {_replace(each, unit='').bounds}",
        "points": "a list of points",
        "table": "a list of numbers for all joints, a list of those with one per joint, or joint: list",
        "group": "a mapping",
    }.get(each.kind, _replace(each, unit="").bounds)
    values = {"box": "box, ", "times": "one or several, "}.get(each.kind, "") + values
    default = each.chosen or each.none or each.unlimited
    if not default:
        default = "required" if each.default is _REQUIRED else f"{_plain(each.default)}"
    unit = f" [{each.unit}]" if each.unit else ""
    cells = (
        f"`{key}`",
        f"{each.text}{unit}",
        f"{'per joint, ' if each.per_joint and each.kind != 'table' else ''}{values}",
        default,
    )
    return tuple(cell.replace("|", "\\|") for cell in cells)


def _plain(value):
    """Return a default as a file has it."""
    if isinstance(value, tuple):
        return [round(x) if x == round(x) else x for x in value]
    return f"{value:g}" if isinstance(value, float) else value


def _rows(declared, prefix=""):
    """Return the rows of declared parameters, those of a group below it."""
    rows = []
    for name, each in declared.items():
        if each.in_file:
            key = f"{prefix}{each.key or name}"
            rows.append(_row(key, each))
            rows += _rows(_parameters(each.group), f"{key}.") if each.kind == "group" else []
    return rows


def modules_list():
    """Return every module with the first line of its docstring, by package, as the layers are ordered."""
    root = _FilePath(__file__).parents[1]
    text = (root / "pyproject.toml").read_text(encoding="utf-8")  # Python 3.10 has no tomllib
    layers = _ast.literal_eval(text.partition("\nlayers = ")[2].partition("]\n")[0] + "]")
    lines = [_line(root / "armgpi" / "__init__.py", root)]
    for layer in reversed(layers):
        packages = _re.split(" [:|] ", layer)
        lines += ["", f"**{', '.join(f'`{package}`' for package in packages)}**", ""]
        for package in packages:
            place = root / "armgpi" / package
            found = sorted(place.rglob("*.py")) or [place.with_suffix(".py")]
            lines += [_line(path, root) for path in found]
    return "\n".join(lines)


def rooms_table():
    """Return what each package says of itself: what it is, takes and gives, as the layers are ordered."""
    root = _FilePath(__file__).parents[1]
    text = (root / "pyproject.toml").read_text(encoding="utf-8")
    layers = _ast.literal_eval(text.partition("\nlayers = ")[2].partition("]\n")[0] + "]")
    rows = ["| room | what it is | takes | gives |", "|---|---|---|---|"]
    for name in (name for layer in reversed(layers) for name in _re.split(" [:|] ", layer)):
        if (place := root / "armgpi" / name / "__init__.py").is_file():
            said = _ast.get_docstring(_ast.parse(place.read_text(encoding="utf-8")))
            first, takes, gives = _re.match(r"(.*)\n\nTakes (.*)\nGives ((?:.+\n?)*)", said).groups()
            cells = (" ".join(each.split()).rstrip(".") for each in (first, takes, gives))
            rows.append(_re.sub(r":[a-z]+:`~?|``", "`", f"| `{name}` | {' | '.join(cells)} |"))
    return "\n".join(rows)


def _line(path, root):
    """Return a module's name with the first line of its docstring."""
    said = _ast.get_docstring(_ast.parse(path.read_text(encoding="utf-8"))).partition("\n")[0]
    return f"- `{path.relative_to(root).as_posix()}`: {_re.sub(r':[a-z]+:`', '`', said)}"


def _registered(base):
    """Return the named classes of the package below `base`, without those that a test declares."""
    found = _all_registered(base).items()
    return {name: cls for name, cls in found if cls.__module__.startswith("armgpi.")}


def playground_list():
    """Return links to the pages to play with that `make playground` has made, or how to make them."""
    shown = {"anthropomorphic3": "The paper's arm", "ur5": "UR5", "panda": "Panda"}
    names = [name for name in shown if (_playground / f"{name}.html").is_file()]
    how = "`make playground` makes pages of the paper's arm, UR5 and Panda ([Playing](play.md))."
    return " · ".join(f'<a href="{name}.html">{shown[name]}</a>' for name in names) or how


_HEADS = [("key", "meaning", "values", "default"), ("---",) * 4]


def plant_table():
    """Return the keys of sensors and actuators, from the arm to the controller."""
    rows = list(_HEADS)
    for name, cls in sorted(_registered(_Wrapper).items(), key=lambda item: item[1].order):
        declared = {key: each for key, each in _parameters(cls).items() if each.in_file}
        if len(declared) == 1:
            rows += [(*_row(name, each)[:3], each.none or "none") for each in declared.values()]
        else:
            rows += [
                (f"`{name}`", cls.__doc__.partition("\n")[0], "a mapping", "none"),
                *_rows(declared, f"{name}."),
            ]
    return _table(rows)


def _by_type(base, key="type"):
    """Return the keys of all named classes below `base`, which a key of the file names."""
    rows = [(f"`{key}`", *_HEADS[0]), ("---",) * 5]
    for name, cls in _registered(base).items():
        own = _rows(_parameters(cls)) or [("", cls.__doc__.partition("\n")[0], "", "")]
        rows += [(f"`{name}`" if index == 0 else "", *row) for index, row in enumerate(own)]
    return _table(rows)


def controllers_table():
    """Return a table for each controller that an experiment file can name."""
    tables = []
    for name, kind in _KINDS.items():
        heads = [(f"key of `{name}`", *_HEADS[0][1:]), _HEADS[1]]
        tables.append(_table([*heads, *_rows(kind.parameters)]))
    return "\n\n".join(tables)


def options_table():
    """Return the options that come from declared parameters."""
    rows = [("option", "meaning"), ("---",) * 2]
    rows += [(f"`{each.flag}` {each.metavar}", each.help.replace("|", "\\|")) for each in _declared.options()]
    return _table(rows)


myst_substitutions = {
    "findings_table": _findings.table(),
    "interfaces_table": _interfaces.table(),
    "known_arms_table": _known_arms.table(),
    "modules_list": modules_list(),
    "rooms_table": rooms_table(),
    "playground_list": playground_list(),
    "metrics_table": metrics_table(),
    "options_table": options_table(),
    "plant_table": plant_table(),
    "supervisor_table": _table([*_HEADS, *_rows(_parameters(_Supervisor))]),
    "reasons_table": _reasons.table(),
    "reality_table": _table([*_HEADS, *_rows(_parameters(_Reality))]),
    "engines_table": _by_type(_Arm, "engine"),
    "loads_table": _by_type(_Load),
    "environment_table": _by_type(_Contact),
    "controllers_table": controllers_table(),
    "paths_table": _by_type(_Path),
}

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
# Shown by their names, not as the unions that they stand for.
autodoc_type_aliases = {
    name: name for name in ("Array", "ArrayLike", "PerJoint", "PerJointInput", "AnyRobot")
}
# "Attributes:" of a class as a list in its text: autodoc already has an entry for each.
napoleon_use_ivar = True

# A reference to one of our own names must resolve. Other projects' names cannot: that would
# take intersphinx, which downloads their inventories.
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!armgpi\b).*"),
    ("py:class", r"armgpi\.config\.schema\.\w+Section"),  # made from declared parameters: see cli.md
]

# MathJax in one file, with its fonts: pages draw formulas without a network.
html_static_path = [str(_files("sphinx-mathjax-offline") / "static" / "mathjax" / "tex-svg.js")]
mathjax_path = "tex-svg.js"
html_theme = "furo"
html_title = f"armgpi {release}"
html_favicon = "images/favicon.svg"
