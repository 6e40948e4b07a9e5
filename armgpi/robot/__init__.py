"""Robots: URDFs read and checked, the equations of motion, kinematics."""
