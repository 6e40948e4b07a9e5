"""From a log of measured positions and commanded torques to the arm that made it."""
