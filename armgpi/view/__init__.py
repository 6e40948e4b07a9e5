"""Seeing rollouts: Matplotlib figures, the MeshCat scene, one offline report file, pages to play with.

Takes rollouts and robots.
Gives figures, pages and a served scene.

:mod:`armgpi.view.style` has the colours and :mod:`armgpi.view.tracks` the lines that all of them share,
:mod:`armgpi.view.plots` the figures,
:mod:`armgpi.view.scene` what is in the scene and how it moves, :mod:`armgpi.view.meshcat` the page and
the server that show it, and :mod:`armgpi.view.report` the report.
"""

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """The module as a function: `armgpi.view(robot)` is :func:`armgpi.view.results.view`."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Return a page with a robot or the animation of a rollout; see :func:`armgpi.view.results.view`."""
        from armgpi.view.results import view

        return view(*args, **kwargs)


sys.modules[__name__].__class__ = _Callable
