"""Reference trajectories: what the joints shall do, as a function of time.

Takes configurations, paths of the tool, recorded trajectories.
Gives a :class:`~armgpi.Reference`, from a time to positions, velocities and accelerations.
"""
