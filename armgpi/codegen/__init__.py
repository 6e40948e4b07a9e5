"""From laws and robots to straight-line C.

Read in this order:

- `symbols`: arrays of expressions that NumPy's functions accept.
- `state`: what a loop carries from sample to sample, as a tree of arrays.
- `effects`: what a user's law reaches besides its arguments, and whether it writes there.
- `model`: equations of motion as expressions, from a `pin.Model`.
- `kernels`: the dynamics in a traced law: every use becomes a call of a generated function.
- `trace`: one sample of a closed loop as expressions, and the numbers that a run puts in.
- `emit`: from expressions to lines of C.
- `build`: from C to a loaded library; the compiler and the cache.

Two kinds of C are made of this: :mod:`armgpi.compiled` (many rollouts, vectors) and ``armgpi.export``
(one controller, C99 for hardware).
"""
