"""Seeing rollouts: Matplotlib figures, the MeshCat scene, and one offline report file.

:mod:`armgpi.viz.style` has the colours and :mod:`armgpi.viz.tracks` the lines that all of them share,
:mod:`armgpi.viz.plots` the figures,
:mod:`armgpi.viz.scene` what is in the scene and how it moves, :mod:`armgpi.viz.meshcat` the page and
the server that show it, and :mod:`armgpi.viz.report` the report.
"""
