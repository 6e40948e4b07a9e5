"""The public name of :mod:`armgpi.viewing.plots`: `import armgpi.plots` gives that module itself."""

import sys

import armgpi.viewing.plots
from armgpi.viewing.plots import *  # noqa: F403  (for type checkers)

sys.modules[__name__] = armgpi.viewing.plots
