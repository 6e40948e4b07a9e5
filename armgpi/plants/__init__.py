"""Plants: what the controller acts on, with its loads, sensors, actuators and faults.

Takes a robot (what the arm really is).
Gives a :class:`~armgpi.Plant`: from a torque to a measurement; draws of what an arm may be (``reality``).
"""
