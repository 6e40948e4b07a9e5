"""What a controller is, and the baselines that the GPI law is compared with.

Takes a robot (the nominal model), a sample time and gains.
Gives a :class:`~armgpi.Controller`: from a measurement and a target to a torque.
"""
