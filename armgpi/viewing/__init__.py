"""Seeing rollouts: Matplotlib figures, the MeshCat scene, one offline report file, pages to play with.

Takes rollouts and robots.
Gives figures, pages and a served scene.

:mod:`armgpi.viewing.style` has the colours and :mod:`armgpi.viewing.tracks` the lines that all of them share,
:mod:`armgpi.viewing.plots` the figures,
:mod:`armgpi.viewing.scene` what is in the scene and how it moves, :mod:`armgpi.viewing.meshcat` the page and
the server that show it, and :mod:`armgpi.viewing.report` the report.
"""
