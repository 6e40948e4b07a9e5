"""Sweeps: the same experiment with other numbers, as many times as it takes to say how often it fails.

- `distributions`: what a number is drawn from, and the draws.
- `intervals`: what so many rollouts say of a probability or a quantile.
- `study`: an experiment, what varies in it and when it has failed; chunks of rollouts, each a function of the
  study and its number alone.
- `workers`: who runs the chunks: this process, or Dask's workers here or on a cluster.
- `results`: all chunks as a dataset, what they say, and the worst of them as experiment files.
- `pictures`: one page with it all.
"""
