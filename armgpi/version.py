"""The version of armgpi, which generated code carries."""

from __future__ import annotations

VERSION = "0.1.0"
