"""A picture as SVG, in coordinates of its own: lines, bars and words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from armgpi.base.arrays import Array
from armgpi.base.escape import html_text

#: Colours of what is drawn: an axis, and words.
LINE, WORDS = "#1b2127", "#5a6570"


#: From where to where.
Ends = tuple[float, float]


class Drawing:
    """A picture whose sides stand for numbers."""

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        width: int = 420,
        height: int = 300,
        below: int = 0,
    ) -> None:
        """Take what the sides stand for, how long they are, and room for words below [px]."""
        self.x, self.y, self.width, self.height, self.below = x, y, width, height, below

    def _place(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of a point in the picture [px]."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return self.width * across, self.height * (1.0 - up)

    def line(
        self, path: Sequence[tuple[float, float]] | Array, colour: str, fill: str = "none", dash: str = ""
    ) -> str:
        """Return a line; `dash` is of pixels, drawn and left out."""
        places = " ".join("{:.1f},{:.1f}".format(*self._place(*each)) for each in path)
        stroke = f'stroke="{colour}" stroke-width="1.5"' + (f' stroke-dasharray="{dash}"' if dash else "")
        return f'<polyline points="{places}" fill="{fill}" {stroke}/>'

    def dots(self, points: Sequence[tuple[float, float]] | Array, colour: str, width: float = 2.0) -> str:
        """Return points as dots of a width [px]; those that are NaN are left out."""
        places = [self._place(x, y) for x, y in points if math.isfinite(x) and math.isfinite(y)]
        moves = "".join(f"M{across:.1f} {up:.1f}h0" for across, up in places)
        return f'<path d="{moves}" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round"/>'

    def bar(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        colour: str,
        opacity: float = 1.0,
        title: str = "",
    ) -> str:
        """Return a rectangle, a pixel narrower than it is so that the next one is seen apart."""
        (left, bottom), (right, top) = (self._place(*each) for each in zip(x, y, strict=True))
        said = f"<title>{html_text(title)}</title>" if title else ""
        return (
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{max(0.5, right - left - 1.0):.1f}" '
            f'height="{bottom - top:.1f}" fill="{colour}" fill-opacity="{opacity:.2f}">{said}</rect>'
        )

    def text(self, x: float, y: float, text: str, anchor: str = "middle", colour: str = WORDS) -> str:
        """Return a text at a point of the picture."""
        across, up = self._place(x, y)
        kind = f'text-anchor="{anchor}" font-size="11" fill="{colour}"'
        return f'<text x="{across:.1f}" y="{up:.1f}" {kind}>{html_text(text)}</text>'

    def svg(self, parts: Iterable[str], words: str = "") -> str:
        """Return the picture, with what it shows for those who cannot see it."""
        width, height = self.width, self.height + self.below
        size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
        label = f' aria-label="{html_text(words)}"' if words else ""
        return f'<svg {size} role="img"{label}>{"".join(parts)}</svg>'


def figure(svg: str, caption: str) -> str:
    """Return a picture with its caption."""
    return f"<figure>{svg}<figcaption>{html_text(caption)}</figcaption></figure>"
