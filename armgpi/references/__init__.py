"""Reference trajectories: what the joints shall do, as a function of time."""
