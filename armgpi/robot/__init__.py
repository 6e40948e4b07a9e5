"""Robots: URDFs read and checked, the equations of motion, kinematics.

Takes a URDF, an MJCF or a ``pin.Model``.
Gives a :class:`~armgpi.Robot`: inertia, bias and gravity, forward and inverse dynamics, frames, drives.
"""
