"""A page to play with: the generated loop as WebAssembly, with a slider for what may be moved.

- `controls`: what may be moved, from what classes declare and from the experiment.
- `loops`: loops whose numbers can all be moved, and the numbers of one.
- `variant`: how every control reaches the numbers of one form of the loop.
- `module`: the C of all forms, and WebAssembly from it.
- `page`: the page.

The C is that of :mod:`armgpi.codegen`. What differs is exact: a factor of 1, a delay that is chosen among
samples kept, measurements lost with probability 0. So what a page shows, run as an experiment file by
generated code, has the same bits.
"""

from armgpi.viewing.play.module import compiler
from armgpi.viewing.play.page import build

__all__ = ["build", "compiler"]
