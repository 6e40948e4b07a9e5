"""A controller as freestanding C99 for hardware: ``armgpi export`` and its parts.

The law is written down from the methods that NumPy runs (`law`), put into C (`code`) together with the
handling of faults (`faults`), and written to a folder with a log to replay (`files`). What was written runs
in :func:`armgpi.simulate` as a controller like any other (`controller`).
"""
