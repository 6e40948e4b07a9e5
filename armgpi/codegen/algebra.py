"""CasADi, which writes the expressions of generated code; without it our error says what to install."""

from armgpi.errors import MissingPackage

try:
    import casadi as ca
except ImportError:
    raise MissingPackage("casadi", "compiled") from None

__all__ = ["ca"]
