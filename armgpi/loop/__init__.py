"""The closed loop: simulation, rollouts and what is measured of them.

- `closed_loop`: plant, controller and reference together; one sample.
- `runner`: the protocol of what takes samples, what drives it, and the loop by NumPy.
- `simulation`: `simulate`, the one verb.
- `rollout`: the dataset, its file. `provenance`: what it was made from.
- `metrics`: what is measured of a rollout. `units`: what quantities are in.
"""
