"""Studies: an experiment run many times with other numbers, each part once, in a folder that keeps it.

Takes an experiment and what varies, or what is free.
Gives samples, rare probabilities and tuned numbers, which an interrupted run resumes to the same bytes.

- `study`: a folder, what it is, which code runs it, and its parts.
- Sampling: `distributions` of what is drawn, `sample` (what varies, chunks of rollouts), `rare` (failures too
  rare to be met at random), `workers` (who runs the chunks), `results` and `page` (what they say).
- Optimisation: `space` (what is free), `objective` (what is wanted), `evaluation` (a generation as one
  batch), `optimisers` (what proposes), `optimise` (the search), `spec` and `setup` (the section `tune` of a
  file), `found` and `pictures` (what it found).
- On these: `contend` (laws held against each other) and `zoo` (every arm with and without tuning).
"""
