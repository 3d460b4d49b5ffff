# SPDX-License-Identifier: GPL-3.0-or-later
"""Write docs/api.md from the docstrings of the public interface, ``ccdepth_addon.core``.

python scripts/api_docs.py            writes the page
python scripts/api_docs.py --check    fails when the page is not what would be written
"""

from __future__ import annotations

import inspect
import re
import sys
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parent.parent
PAGE = CHECKOUT / "docs" / "api.md"

INTRODUCTION = """# The core as a library

`ccdepth_addon.core` needs numpy alone. This page is made from its docstrings by `python scripts/api_docs.py`.

```python
import numpy as np
from ccdepth_addon.core import apply_boundary_rule, face_depths, polygon_mesh

corners = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
quads = np.array([[2, 3, 1, 0], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]])
cube = polygon_mesh(corners, np.full(6, 4), quads.ravel())
result = face_depths(apply_boundary_rule(cube, smooth_corners=True), 0.001, "DISTANCE", "LIMIT")
print(result.depths, result.bounds)
```
"""


def page() -> str:
    """The text of docs/api.md."""
    sys.path.insert(0, str(CHECKOUT))
    from ccdepth_addon import core

    sections: dict[str, list[str]] = {}
    for name in core.__all__:
        item = getattr(core, name)
        module = getattr(item, "__module__", "")
        if inspect.isclass(item) or inspect.isfunction(item):
            sections.setdefault(module.removeprefix("ccdepth_addon.core."), []).append(_entry(name, item))
    parts = [INTRODUCTION]
    for module in sorted(sections):
        parts.append(f"## {module}\n\n" + "\n".join(sections[module]))
    return "\n".join(parts)


def _entry(name: str, item: Any) -> str:
    text = inspect.cleandoc(item.__doc__ or "")
    if inspect.isfunction(item) or is_dataclass(item):
        # Defaults that are functions or members of enums are given by their names alone.
        heading = re.sub(r"<(?:function )?([\w.]+)(?: at 0x|: )[^>]*>", r"\1", f"{name}{inspect.signature(item)}")
        heading = heading.removesuffix(" -> None") if is_dataclass(item) else heading
    elif issubclass(item, Enum):
        heading = f"{name}: {', '.join(item.__members__)}"
    else:
        heading = name
    return f"### {name}\n\n```python\n{heading.replace('ccdepth_addon.core.', '')}\n```\n\n{text}\n"


def main(arguments: list[str]) -> int:
    if arguments == ["--check"]:
        return 0 if PAGE.read_text(encoding="utf-8") == page() else 1
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
