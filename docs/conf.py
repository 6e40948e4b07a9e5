"""Sphinx configuration. Build with `make docs`; no network is used."""

from importlib.metadata import version as _version

from armgpi.loop import metrics as _metrics

project = "armgpi"
author = "The armgpi developers"
project_copyright = author
release = version = _version("armgpi")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "substitution"]
myst_heading_anchors = 3  # lets pages link to each other's headings


def metrics_table():
    """Return the metrics as a Markdown table, from their declarations."""
    rows = [("column", "name in files", "meaning", "unit", "shown in"), ("---",) * 5]
    for name, metric in _metrics.ALL.items():
        meaning = metric.function.__doc__.partition("\n\n")[0].removeprefix("Return ").rstrip(".")
        row = (metric.heading, f"`{name}`", meaning, str(metric.unit) or "–", ", ".join(metric.tables))
        rows.append(tuple(cell.replace("|", "\\|").replace("``", "`") or "files alone" for cell in row))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


myst_substitutions = {"metrics_table": metrics_table()}

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
nitpick_ignore_regex = [("py:.*", r"(?!armgpi\b).*")]

html_theme = "furo"
html_title = "armgpi"
