# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the manual that the extension brings along, a page for browsers, from docs/manual.md.

python scripts/manual_page.py            writes the page
python scripts/manual_page.py --check    fails when the page is not what would be written

The script knows the Markdown of the manual: headings, paragraphs, lists, tables, pictures, and marks inside lines.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
SOURCE = CHECKOUT / "docs" / "manual.md"
PAGE = CHECKOUT / "ccdepth_addon" / "manual" / "index.html"

FRAME = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>CC Depth Manual</title>
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 1rem/1.55 system-ui, sans-serif; max-width: 48rem; margin: 2rem auto; padding: 0 1rem; }}
h2 {{ margin-top: 2.2em; }}
img {{ max-width: 100%; border-radius: 6px; }}
code, kbd {{ font-family: ui-monospace, monospace; font-size: 0.92em; }}
kbd {{ border: 1px solid #8888; border-radius: 4px; padding: 0 0.3em; }}
table {{ border-collapse: collapse; }}
td, th {{ border-bottom: 1px solid #8884; padding: 0.3em 1em 0.3em 0; text-align: left; }}
</style>
</head>
<body>
{body}
</body>
</html>
"""

# The order matters: code and tags are not marked again.
MARKS = (
    (r"`([^`]+)`", r"<code>\1</code>"),
    (r"!\[([^]]*)\]\([^)]*?([^/)]+)\)", r'<img src="\2" alt="\1">'),
    (r"\[([^]]+)\]\(([^)]+)\)", r'<a href="\2">\1</a>'),
    (r"\*\*([^*]+)\*\*", r"<strong>\1</strong>"),
    (r"\*([^*]+)\*", r"<em>\1</em>"),
)

ITEM = re.compile(r"^(?:- |\d+\. )")


def page() -> str:
    """The text of the page."""
    blocks = SOURCE.read_text(encoding="utf-8").strip().split("\n\n")
    return FRAME.format(body="\n".join(map(_block, blocks)))


def anchor(heading: str) -> str:
    """The anchor of a heading, as in other renderers of Markdown."""
    return re.sub(r"[^a-z0-9]+", "-", heading.lower()).strip("-")


def _block(text: str) -> str:
    heading = re.match(r"(#+) (.*)$", text)
    if heading:
        level, name = len(heading[1]), heading[2]
        return f'<h{level} id="{anchor(name)}">{_line(name)}</h{level}>'
    if text.startswith("|"):
        return _table(text.splitlines())
    if ITEM.match(text):
        return _list(text)
    return f"<p>{_line(text)}</p>"


def _list(text: str) -> str:
    """The items of a list; an indented line continues the line above."""
    kind = "ul" if text.startswith("- ") else "ol"
    items = re.split(r"\n(?=- |\d+\. )", text)
    joined = (re.sub(r"\s*\n\s+", " ", ITEM.sub("", item)) for item in items)
    rows = [f"<li>{_line(item)}</li>" for item in joined]
    return "\n".join([f"<{kind}>", *rows, f"</{kind}>"])


def _table(lines: list[str]) -> str:
    head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    parts = ["<table>", _row(head, "th"), *(_row(row, "td") for row in rows), "</table>"]
    return "\n".join(parts)


def _row(cells: list[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{_line(cell)}</{tag}>" for cell in cells) + "</tr>"


def _line(text: str) -> str:
    for pattern, tag in MARKS:
        text = re.sub(pattern, tag, text)
    return text


def main() -> int:
    if "--check" in sys.argv:
        return 0 if PAGE.exists() and PAGE.read_text(encoding="utf-8") == page() else 1
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
