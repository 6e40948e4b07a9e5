"""Generated code: a closed loop as C that takes several rollouts at once.

``simulate(..., backend="compiled")`` writes one sample of the loop down as expressions (`trace`), from the
same functions that NumPy runs, with the dynamics from a symbolic model (`model`) that is checked against
Pinocchio; emits it as straight-line C (`emit`); compiles and keeps it (`build`); and runs it (`run`).
"""
