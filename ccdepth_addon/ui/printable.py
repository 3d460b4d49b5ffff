# SPDX-License-Identifier: GPL-3.0-or-later
"""Text for terminals: names of objects and files may hold anything, and a terminal obeys control characters."""

from __future__ import annotations

import unicodedata

# Controls, invisible marks that reorder text, halves of characters, and separators of lines and paragraphs.
ESCAPED_CATEGORIES = {"Cc", "Cf", "Cs", "Zl", "Zp"}

# The characters that join the parts of letters and pictures.
JOINERS = {"\u200c", "\u200d"}


def printable(text: str) -> str:
    """The text with every control character as its escape sequence in Python."""
    return "".join(map(_printable, text))


def printable_lines(text: str) -> str:
    """A text of several lines with every control character in a line as its escape sequence."""
    return "\n".join(map(printable, text.split("\n")))


def _printable(character: str) -> str:
    if unicodedata.category(character) not in ESCAPED_CATEGORIES or character in JOINERS:
        return character
    return character.encode("unicode_escape", errors="backslashreplace").decode()
