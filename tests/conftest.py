"""What every test shares. That this file is here also lets tests import `strategies`, beside it."""

from __future__ import annotations

from hypothesis import settings

# The machine may be busy with something else: an example that takes long is no failure.
settings.register_profile("armgpi", deadline=None, print_blob=True)
settings.load_profile("armgpi")
