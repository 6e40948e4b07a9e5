"""A closed loop as C that takes several rollouts at once: ``simulate(..., backend="compiled")``.

- `source`: one sample of the loop, with the dynamics and all around it, as C.
- `lanes.h`: arithmetic on several numbers at once, one rollout in each.
- `loop.h`: the loop over samples: random numbers, divergence, recording.
- `run`: runs it, as a :class:`armgpi.loop.runner.Runner`.

The sample comes from the functions that NumPy runs (:mod:`armgpi.codegen.trace`). All numbers of a run
(gains, payloads, loads, seeds, the start) are inputs of the code, so that another run compiles nothing.
"""
