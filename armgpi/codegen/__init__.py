"""From laws and robots to straight-line C: symbols, traces, kernels, compilers."""
