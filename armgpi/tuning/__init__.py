"""Automatic, model-based tuning: what GPI takes for an arm that nobody tuned, and what that tolerates.

Takes an arm as it is known (with its drives), a sample time, delay and encoders.
Gives parameters of :class:`~armgpi.GPI` and findings, which who asked for them shows; ``GPI.auto`` asks.

Read ``rule`` first: ``collocated`` has the controller for encoders at the motors in closed form, ``geared``
looks for the fastest one for elastic joints, both on the sampled loops of ``two_mass``; ``verdict`` says what
a controller tolerates, ``kept`` keeps what was found.
"""
