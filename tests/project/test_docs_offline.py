"""A built page asks the network for nothing (scripts, styles, fonts, pictures), and draws its formulas."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import browser as browsers
import pytest

DOCS = Path(__file__).parents[2] / "docs"
#: A formula, code, a table and a grid: what brings scripts and styles into a page.
PAGE = """# A page

$\\dot x = -x$

```python
x = 1
```

| a | b |
|---|---|
| 1 | $y^2$ |

::::{grid} 1
:::{grid-item-card} Card
:::
::::
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page, built as the documentation is."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("out")
    (source / "index.md").write_text(PAGE, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-q", "-c", DOCS, "-d", source / "trees", source, out]
    subprocess.run(command, check=True, capture_output=True)
    return out / "index.html"


@pytest.mark.slow
def test_no_file_of_a_built_page_names_an_address_to_load_from(built: Path) -> None:
    html = built.read_text(encoding="utf-8")
    loaded = re.findall(r"<(?:script|img|iframe|source)\b[^>]*?\bsrc=\"([^\"]*)\"", html)
    loaded += re.findall(r"<link\b[^>]*?\bhref=\"([^\"]*)\"", html)
    for style in built.parent.rglob("*.css"):
        loaded += re.findall(r"(?:@import\s+|url\()['\"]?([^'\")\s]+)", style.read_text(encoding="utf-8"))
    assert any("tex-svg.js" in each for each in loaded)
    assert not [each for each in loaded if re.match(r"(https?:)?//", each)]


@pytest.mark.slow
def test_a_browser_without_a_network_draws_the_formulas(built: Path) -> None:
    if browsers.program() is None:
        pytest.skip("no browser is installed")
    browser = browsers.Browser()
    try:
        page = browser.open(built, "document.querySelectorAll('mjx-container svg').length === 2")
        assert not page.errors
        assert not [each for each in page.requests if not each.startswith(("file:", "data:"))]
    finally:
        browser.close()


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.stem)
def test_a_page_shows_no_picture_from_elsewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r"!\[[^\]]*\]\(https?:|<(?:script|img|iframe)\b[^>]*https?:", text)
