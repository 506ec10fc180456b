"""Hooks of MkDocs: equations as MathML, so that the site needs no script of others; links out of docs/ stay as text."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

_MATH = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.S)
_OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+(?!docs/)([A-Z]+\.md)\)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links to files of the project beside docs/ become their names, since the site does not contain them."""
    return _OUTSIDE.sub(r"\1 (`\2`)", markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Equations from LaTeX to MathML."""

    def one(found: re.Match[str]) -> str:
        kind, _, text = found.groups()
        made = convert(html.unescape(text).strip(), display="block" if kind == "div" else "inline")
        if unknown := re.search(r"\\\w+", made):
            raise ValueError(f"no MathML for {unknown[0]} in the equation {text.strip()}: write it with other commands")
        return made

    return _MATH.sub(one, content)
