"""The closed loop: simulation, rollouts, logs, and what is measured of them.

Takes a plant, a controller and a reference.
Gives a rollout, an ``xarray.Dataset``, and its metrics.

- `closed_loop`: plant, controller and reference together; one sample.
- `runner`: the protocol of what takes samples, what drives it, and the loop by NumPy.
- `prepared`: a loop that runs with new numbers as often as wanted. `variables`: which, and how they get in.
- `simulation`: `simulate`, the one verb.
- `running`: what is added up where no trajectories are kept.
- `rollout`: the dataset, its file. `provenance`: what it was made from.
- `metrics`: what is measured of a rollout. `units`: what quantities are in.
"""
