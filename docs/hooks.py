"""What the site needs without a network: formulas as MathML, and the search's worker from beside the pages."""

from __future__ import annotations

import re
from typing import Any

from latex2mathml.converter import convert

WORKER = re.compile(r'https://[^"]*/iframe-worker/shim')
"""What pages opened from a disk search with; the plugin `offline` names it where it is published."""


def render(source: str, *args: Any, **held: Any) -> str:
    """Return a fenced block of LaTeX, one equation a line, as MathML, which browsers draw without a script."""
    lines = (line for line in source.splitlines() if line.strip())
    return "".join(
        f'<div class="equation">{convert(line, display="block")}</div>' for line in lines
    )


SPOKEN = {
    'data-md-component="search" role="dialog"': 'data-md-component="search" role="dialog" aria-label="Search"',
    "<th></th>": "<td></td>",
}
"""What pages lack for those who use keyboards and screen readers: a name, heads that say something."""


def on_post_page(output: str, **held: Any) -> str:
    """Load the search's worker from the site itself, and add what `SPOKEN` lists."""
    for found, better in SPOKEN.items():
        output = output.replace(found, better)
    return WORKER.sub("scripts/iframe-worker.js", output)


on_post_template = on_post_page
