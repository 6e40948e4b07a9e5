"""From a log of measured positions and commanded torques to the arm that made it.

Takes logs and the URDF.
Gives the URDF with its inertias, drives with intervals, draws of the posterior; a motion that excites.
"""
