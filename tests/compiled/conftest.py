"""Compiled libraries go into one folder for the whole session, which its processes share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Point ARMGPI_CACHE to a folder beside those of all pytest-xdist workers."""
    base = tmp_path_factory.getbasetemp()
    if base.name.startswith("popen-"):  # a worker's own
        base = base.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARMGPI_CACHE", str(base / "armgpi-cache"))
        yield
