"""The closed loop: simulation, rollouts and what is measured of them."""
