"""The public name of :mod:`armgpi.loop.metrics`: `import armgpi.metrics` gives that module itself."""

import sys

import armgpi.loop.metrics
from armgpi.loop.metrics import *  # noqa: F403  (for type checkers)

sys.modules[__name__] = armgpi.loop.metrics
