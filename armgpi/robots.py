"""The public name of :mod:`armgpi.robot.robots`: `import armgpi.robots` gives that module itself."""

import sys

import armgpi.robot.robots
from armgpi.robot.robots import *  # noqa: F403  (for type checkers)

sys.modules[__name__] = armgpi.robot.robots
