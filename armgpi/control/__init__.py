"""Controllers: the GPI law of the paper, its gains, and the baselines it is compared with."""
