# SPDX-License-Identifier: GPL-3.0-or-later
"""A report as a page for people: a single file of HTML that loads nothing, with the pictures of the report."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape

import bpy

from .. import version
from ..state.colors import depth_colors
from ..state.properties import VERTEX_TEXTS
from ..ui.facts import factors_text, ratio_texts, share_text
from ..ui.lengths import DIGITS, Rounding, printable
from .report import (
    ACTION_TEXTS,
    YES_OR_NO,
    FileEntry,
    FileStamp,
    ObjectEntry,
    Report,
    ReportPictures,
    degrees_rounded_up,
    enough_digits_in_metres,
    losses,
    metres_text,
)

# A verdict has a sign and words, not only a colour.
GOOD, BAD, NEUTRAL = ("good", "✓"), ("bad", "✗"), ("neutral", "–")

# Nothing else may be loaded, for any contents of the names of objects and files.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"

STYLE = """
:root { color-scheme: light dark;
  --page: #f5f6f8; --card: #ffffff; --text: #1c1f24; --quiet: #59616c; --line: #d9dde3;
  --good: #146c3a; --good-back: #dff3e6; --bad: #a3231b; --bad-back: #fbe4e2; --neutral-back: #e9ecf0; }
@media (prefers-color-scheme: dark) { :root {
  --page: #15171a; --card: #1e2125; --text: #e6e8eb; --quiet: #a0a7b1; --line: #363b42;
  --good: #7ddca0; --good-back: #173524; --bad: #ffa59d; --bad-back: #43201d; --neutral-back: #2d3238; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 2rem 1.25rem 4rem; background: var(--page); color: var(--text);
  font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1, h2, h3, h4 { line-height: 1.25; margin: 0; font-weight: 650; }
h1 { font-size: 1.75rem; } h2 { font-size: 1.3rem; margin-top: 3rem; } h3 { font-size: 1.15rem; }
h4 { font-size: .95rem; margin: 1.25rem 0 .5rem; }
p { margin: .35rem 0; } a { color: inherit; }
.quiet, figcaption { color: var(--quiet); font-size: .9rem; }
.verdict { display: inline-block; border-radius: 1rem; padding: .1rem .75rem; font-size: .9rem; font-weight: 600; }
.good { color: var(--good); background: var(--good-back); } .bad { color: var(--bad); background: var(--bad-back); }
.neutral { color: var(--quiet); background: var(--neutral-back); }
.card { background: var(--card); border: 1px solid var(--line); border-radius: .6rem; padding: 1.25rem;
  margin-top: 1rem; }
.heading { display: flex; flex-wrap: wrap; gap: .35rem .9rem; align-items: center; }
.error { color: var(--bad); white-space: pre-wrap; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr)); gap: 1.25rem;
  margin-top: 1.25rem; }
figure { margin: 0; } figure:has(:checked) { grid-column: 1 / -1; } label { display: block; cursor: zoom-in; }
figure:has(:checked) label { cursor: zoom-out; } label:focus-within { outline: 2px solid; border-radius: .4rem; }
input { position: absolute; opacity: 0; } img { display: block; width: 100%; height: auto; border-radius: .4rem; }
figcaption { margin-top: .35rem; }
dl { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 11.5rem), 1fr)); gap: .9rem 1.25rem;
  margin: 1.25rem 0 0; }
dt { color: var(--quiet); font-size: .85rem; } dd { margin: 0; font-weight: 600; }
dd small { display: block; font-weight: 400; font-size: .78rem; color: var(--quiet); white-space: nowrap; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-size: .93rem;
  font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .35rem .6rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { color: var(--quiet); font-size: .85rem; font-weight: 500; }
th:first-child, td:first-child { text-align: left; padding-left: 0; white-space: normal; min-width: 9rem; }
.files td:nth-child(2), .files th:nth-child(2) { text-align: left; }
.depths td { border: 0; padding: .1rem .6rem .1rem 0; } .depths td:nth-child(2) { width: 60%; }
.depths div { height: 1.1rem; min-width: 1px; border-radius: 2px; }
code { font: .85em ui-monospace, monospace; overflow-wrap: anywhere; }
@media print { .card { break-inside: avoid; } body { background: none; } }
"""


def page(report: Report) -> str:
    """The page of a report. Files are named as in the report; all contents of names are shown as text."""
    title = f"CC Depth Report: {ACTION_TEXTS[report.action]}"
    sections = "".join(_file_section(number, entry) for number, entry in enumerate(report.files))
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>{_text(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<header>
<h1>CC Depth Report</h1>
<p class="heading">{_report_verdict(report)}<span>{_text(_summary(report))}</span></p>
<p class="quiet">{_text(f"CC Depth {version()} in Blender {bpy.app.version_string}")}</p>
</header>
{_file_table(report.files) if len(report.files) > 1 else ""}
<main>{sections}</main>
</body>
</html>
"""


def _text(text: object) -> str:
    """Any text as HTML."""
    return escape(printable(str(text)))


def _verdict(kind: tuple[str, str], words: str) -> str:
    name, sign = kind
    return f'<span class="verdict {name}">{sign} {_text(words)}</span>'


def _report_verdict(report: Report) -> str:
    if not report.is_good:
        failed = sum(entry.error is not None for entry in report.files)
        return _verdict(BAD, f"{_count(failed, 'file')} failed" if failed else "A tolerance is not met")
    if any(each.met for entry in report.files for each in entry.objects):
        return _verdict(GOOD, "Every tolerance is met")
    return _verdict(GOOD, "All is done")


def _summary(report: Report) -> str:
    objects = [each for entry in report.files for each in entry.objects]
    measured = [each for each in objects if each.met is not None]
    parts = [ACTION_TEXTS[report.action], _count(len(report.files), "file"), _count(len(objects), "object")]
    if measured:
        met = sum(each.met is True for each in measured)
        parts.append(f"tolerance met by {met:,} of {len(measured):,} measured")
    return " · ".join(parts)


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def _file_verdict(entry: FileEntry) -> str:
    if entry.error is not None:
        return _verdict(BAD, "Failed")
    if not entry.is_good:
        return _verdict(BAD, "Not met")
    return _verdict(GOOD, "Met" if any(each.met for each in entry.objects) else "Done")


def _file_table(entries: Sequence[FileEntry]) -> str:
    """All files in a few words each, with links to their sections."""
    rows = [
        [
            f'<a href="#file-{number}">{_text(entry.name)}</a>',
            _file_verdict(entry),
            f"{len(entry.objects):,}",
            f"{sum(each.faces for each in entry.objects):,}",
        ]
        for number, entry in enumerate(entries)
    ]
    head = "".join(f'<th scope="col">{heading}</th>' for heading in ("File", "Result", "Objects", "Faces"))
    lines = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return (
        '<section class="card files"><div class="scroll">'
        f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div></section>"
    )


def _file_section(number: int, entry: FileEntry) -> str:
    parts = [f'<h2 id="file-{number}">{_text(entry.name)}</h2>']
    if entry.source is not None:
        parts.append(_stamp_line("SHA-256", entry.source))
    if entry.output is not None:
        parts.append(_stamp_line(f"Written to {entry.output.path}, SHA-256", entry.output))
    parts += [_stamp_line(f"With it {each.path}, SHA-256", each) for each in entry.companions]
    parts += [f'<p class="quiet">{_text(text)}</p>' for text in losses(entry)]
    if entry.error is not None:
        error = "\n".join(_text(line) for line in entry.error.split("\n"))
        parts.append(f'<div class="card">{_file_verdict(entry)}<p class="error">{error}</p></div>')
    pictures = entry.pictures or (None,) * len(entry.objects)
    parts += [_object_card(*pair) for pair in zip(entry.objects, pictures, strict=True)]
    return f"<section>{''.join(parts)}</section>"


def _stamp_line(label: str, stamped: FileStamp) -> str:
    checksum = f"<code>{_text(stamped.sha256)}</code>" if stamped.sha256 else "none, as it cannot be read"
    return f'<p class="quiet">{_text(label)}: {checksum}</p>'


def _object_card(entry: ObjectEntry, pictures: ReportPictures | None) -> str:
    facts = "".join(f"<div><dt>{_text(name)}</dt><dd>{value}</dd></div>" for name, value in _facts(entry).items())
    drawn = "" if pictures is None else _figures(entry, pictures) + _histogram(pictures.faces_by_depth)
    return (
        f'<article class="card"><div class="heading"><h3>{_text(entry.name)}</h3>{_object_verdict(entry)}</div>'
        f"<dl>{facts}</dl>{drawn}</article>"
    )


def _object_verdict(entry: ObjectEntry) -> str:
    if entry.met is None:
        return _verdict(NEUTRAL, "Not measured")
    return _verdict(GOOD, "Tolerance met") if entry.met else _verdict(BAD, "Tolerance not met")


def _facts(entry: ObjectEntry) -> dict[str, str]:
    """The numbers of an object, as HTML, by their names."""
    numbers = {
        "Deepest depth": entry.deepest,
        "Level for all faces": entry.level,
        "At frame": entry.deepest_frame,
        "Faces at that level" if entry.result is None else "Faces made": entry.result_faces,
        "Triangles written": entry.triangles,
    }
    measured = entry.measured.proved if entry.measured else None
    proved = {"Proved distance, at most": entry.proved, "Measured, at most": measured}
    bounds = {name: bound for name, bound in proved.items() if bound is not None}
    digits = enough_digits_in_metres(entry.tolerance, *bounds.values())
    facts = {"Tolerance": _length(entry.tolerance, digits=digits), "Faces": f"{entry.faces:,}"}
    if entry.vertices is not None:
        facts["Vertices"] = VERTEX_TEXTS[entry.vertices][0]
    facts |= {name: f"{number:,}" for name, number in numbers.items() if number is not None}
    facts |= {name: _length(bound, Rounding.UP, digits) for name, bound in bounds.items()}
    angles = {"Proved shading angle, at most": entry.proved_shading, "Proved facet angle, at most": entry.proved_facets}
    facts |= {name: f"{degrees_rounded_up(found):.4g}°" for name, found in angles.items() if found is not None}
    if entry.measured is not None:
        facts["Measured, at least"] = _length(entry.measured.reached, Rounding.DOWN)
    if entry.measured is not None and entry.factors:
        facts["Tolerance"] += f"<br>{factors_text(entry.factors)}"
        lengths = entry.measured.proved, entry.measured.reached, entry.tolerance
        facts |= dict(zip(("Measured, at most", "Measured, at least"), ratio_texts(*lengths), strict=True))
    if entry.lod_distance is not None:
        facts["Under a pixel from"] = _length(entry.lod_distance, Rounding.UP)
        facts["Size in the view there"] = f"{entry.lod_screen_size:.1%}"
    angles = {"Facets, at samples": entry.facet_angle, "Shading, at samples": entry.shading_angle}
    facts |= {name: f"{angle:.2f}°" for name, angle in angles.items() if angle is not None}
    told = {"Closed": entry.closed, "Oriented": entry.oriented}
    return facts | {name: YES_OR_NO[is_so] for name, is_so in told.items() if is_so is not None}


def _length(length: float, rounding: Rounding = Rounding.NEAREST, digits: int = DIGITS) -> str:
    """A length in the unit that suits it, and in full in metres."""
    return f"{_text(metres_text(length, rounding, digits))}<small>{_text(repr(length))} m</small>"


def _figures(entry: ObjectEntry, pictures: ReportPictures) -> str:
    name = entry.result or entry.name
    kinds = (("Heat map", pictures.heat_map), ("Wireframe", pictures.wireframe))
    figures = "".join(
        f'<figure><label><input type="checkbox" aria-label="{_text(f"Enlarge the {kind.lower()} of {name}")}">'
        f'<img src="{_picture_url(content)}" alt="{_text(f"{kind} of {name}")}"></label>'
        f"<figcaption>{_text(kind)}</figcaption></figure>"
        for kind, content in kinds
    )
    return f'<div class="pair">{figures}</div>'


def _picture_url(content: bytes) -> str:
    kind = "webp" if content.startswith(b"RIFF") else "png"
    return f"data:image/{kind};base64,{b64encode(content).decode()}"


def _histogram(faces_by_depth: Sequence[tuple[int, int]]) -> str:
    """A bar for each depth, in its colour; nothing without known depths."""
    if not faces_by_depth:
        return ""
    total = sum(faces for _, faces in faces_by_depth)
    rows = "".join(
        f'<tr><td>{depth}</td><td><div style="width:{faces / total:.1%};background:{_color(depth)}"></div></td>'
        f"<td>{_text(share_text(faces, total))}</td></tr>"
        for depth, faces in faces_by_depth
    )
    return f'<h4>Faces by Depth</h4><table class="depths">{rows}</table>'


def _color(depth: int) -> str:
    """The colour of a depth, the same everywhere."""
    [color] = depth_colors([depth]).tolist()
    return "#" + "".join(f"{round(255 * part):02x}" for part in color)
