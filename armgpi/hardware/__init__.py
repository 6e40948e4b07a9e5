"""A controller outside simulation.

Takes a controller.
Gives it as C with packages for robots (``export``); a loop between processes, and stages
to bring an arm up with (``realtime``).
"""
