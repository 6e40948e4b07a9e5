"""Certificates: a bound on the whole arm's error that another program checks exactly.

Takes a robot, a GPI controller and what may disturb them.
Gives a certificate, or the bound of one path in mm, each with its page.
"""
