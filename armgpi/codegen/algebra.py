"""CasADi, which writes the expressions of generated code; without it our error says what to install."""

from armgpi.errors import import_extra

ca = import_extra("casadi", "compiled")

__all__ = ["ca"]
