"""The old place of declared parameters, :mod:`armgpi.base.parameter`; kept for one version."""

from armgpi.base.parameter import *  # noqa: F403
from armgpi.base.renamed import warn_renamed

warn_renamed("armgpi.parameter", "armgpi.base.parameter")
