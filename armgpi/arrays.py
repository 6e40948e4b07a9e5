"""The old place of arrays and their checks, :mod:`armgpi.base.arrays`; kept for one version."""

from armgpi.base.arrays import *  # noqa: F403
from armgpi.base.renamed import warn_renamed

warn_renamed("armgpi.arrays", "armgpi.base.arrays")
