"""Seeing rollouts: Matplotlib figures, the MeshCat scene, one offline report file, pages to play with.

Takes rollouts and robots.
Gives figures, pages and a served scene.

:mod:`armgpi.view.style` has the colours and :mod:`armgpi.view.tracks` the lines that all of them share,
:mod:`armgpi.view.plots` the figures,
:mod:`armgpi.view.scene` what is in the scene and how it moves, :mod:`armgpi.view.meshcat` the page and
the server that show it, and :mod:`armgpi.view.report` the report.
"""
