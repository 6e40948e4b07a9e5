"""The GPI law: what it computes, its gains and networks, what its loop tolerates.

Takes a robot (the nominal model), a sample time, delay, encoders and drives.
Gives :class:`~armgpi.GPI`, tuned by hand or by a rule (``GPI.auto``).

Read ``law``, ``family``, ``realisation``, ``gains`` first; ``margins``, ``payload`` and ``advice`` judge
gains, and no sample of a loop calls them. The rule that chooses for an arm is in ``armgpi.tuning``.
"""
