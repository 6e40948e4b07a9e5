"""Certificates: a bound on the whole arm's error that another program checks exactly."""
