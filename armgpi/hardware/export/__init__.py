"""A controller as freestanding C99 for hardware: ``armgpi export`` and its parts.

- `law`: the controller's `init` and `step` as expressions, from the methods that NumPy runs.
- `code`: from those to header and source, with counts of operations.
- `supervision`: the checks around the law, as C. `faults`: what counts as a fault, in numbers.
- `layout`, `names`: text of C, names that C can have. `templates/`: the files with what is always the same.
- `files`: the folder, with a log to replay.
- `controller`: exported code as a controller in :func:`armgpi.simulate`.
"""
