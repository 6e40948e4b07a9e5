"""From laws and robots to C: traced, generated, compiled and run.

Takes a closed loop.
Gives the same loop as C, for several rollouts at once (``simulate(..., backend="compiled")``), in a page
(``armgpi.viewing.play``) or for hardware (``armgpi.hardware.export``).

Read in this order:

- `symbols`: arrays of expressions that NumPy's functions accept.
- `state`: what a loop carries from sample to sample, as a tree of arrays.
- `effects`: what a user's law reaches besides its arguments, and whether it writes there.
- `model`: equations of motion as expressions, from a `pin.Model`.
- `kernels`: the dynamics in a traced law: every use becomes a call of a generated function.
- `trace`: one sample of a closed loop as expressions, and the numbers that a run puts in.
- `emit`: from expressions to lines of C.
- `build`: from C to a loaded library; the compiler and the cache.
- `source`: one sample of the loop, with the dynamics and all around it, as C. `lanes.h`: arithmetic on
  several numbers at once, one rollout in each. `loop.h`: random numbers, divergence, recording.
- `run`: runs it, as a :class:`armgpi.loop.runner.Runner`.

All numbers of a run (gains, payloads, loads, seeds, the start) are inputs of the code, so that another run
compiles nothing.
"""
