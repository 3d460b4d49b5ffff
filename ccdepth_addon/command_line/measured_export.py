# SPDX-License-Identifier: GPL-3.0-or-later
"""The background Blender of Export Within Tolerance: a written file, read back and measured, and its certificate."""

from __future__ import annotations

import pickle
from pathlib import Path

from ..exchange.blender_calls import CommandError
from ..operators.export_within import REPORT, REQUEST, Written
from .one_file import adaptive_entry, as_held, stamps, with_answer
from .report import SUBDIVIDE, Chosen, FileEntry, Report, json_text, stamp
from .written_meshes import measured_distances, read_written


def measure_export(folder: Path) -> None:
    """Measure the file of the request in a folder, and write the report of it there."""
    written: Written = pickle.loads((folder / REQUEST).read_bytes())
    try:
        entry = _measured(written)
    except (CommandError, OSError) as fault:
        entry = FileEntry(None, error=str(fault))
    (folder / REPORT).write_text(
        json_text(Report(SUBDIVIDE, (entry,)), written.place.parent, with_pictures=False), encoding="utf-8"
    )


def _measured(written: Written) -> FileEntry:
    """The entry of a written file. Raises CommandError and OSError."""
    # Before the file is read back.
    output, companions = stamps(written.path, written.place, written.unit)
    triangles = {name: part.triangles for name, part in written.parts.items()}
    found = read_written(written.path, written.unit / written.scene, triangles)
    entries = []
    for (name, part), measured in zip(written.parts.items(), found, strict=True):
        answer = measured_distances(part.task, measured, written.measuring)
        entry = adaptive_entry(name, part.faces, part.facts, written.settings, written.scene)
        entries.append(as_held(with_answer(entry, answer, written.scene), measured))
    source = None if written.source is None else stamp(written.source, written.scene)
    return FileEntry(
        source,
        tuple(entries),
        output=output,
        chosen=Chosen([*written.parts], None),
        left_out=(),
        companions=companions,
        lost=written.lost,
    )
