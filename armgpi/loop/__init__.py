"""The closed loop: simulation, rollouts and what is measured of them.

- `closed_loop`: plant, controller and reference together; one sample.
- `runner`: the protocol of what takes samples, what drives it, and the loop by NumPy.
- `prepared`: a loop that runs with new numbers as often as wanted. `variables`: which, and how they get in.
- `simulation`: `simulate`, the one verb.
- `running`: what is added up where no trajectories are kept.
- `rollout`: the dataset, its file. `provenance`: what it was made from.
- `metrics`: what is measured of a rollout. `units`: what quantities are in.
"""
