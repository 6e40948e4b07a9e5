"""Hand-derived dynamics beside Pinocchio's: what differs, where, and what the mistake is.

Takes functions (Python, SymPy, CasADi) and a robot.
Gives a report that names the mistake; also closed forms of a robot (``derive``) and the way back to a URDF.
"""
