# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Export Within Tolerance: adaptive meshes as temporary data, written to a file, which another Blender measures."""

from __future__ import annotations

import json
import pickle
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import inf, nextafter
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep
from typing import Any, ClassVar, NamedTuple

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ..core import Progress
from ..exchange.blender_calls import CommandError, end_of, own_process
from ..exchange.custom_normals import smooth_faces
from ..exchange.data_blocks import meshes_with
from ..exchange.displayed_mesh import read_shown_mesh
from ..exchange.evaluated import with_other_meshes
from ..exchange.mesh_files import (
    SHADING_LOST,
    UNITS,
    WITHOUT_NORMALS,
    WRITERS,
    names_of,
    refuse_place,
    triangles_in,
    unit_of,
    write_meshes,
    writer,
    written_there,
)
from ..exchange.modifiers import applied_modifiers, left_out_sculpting
from ..state import result_record
from ..state.chosen import chosen
from ..state.mesh_values import AdaptiveFacts
from ..state.properties import Settings
from ..tasks.adaptive_task import prepare_adaptive
from ..tasks.deviation_task import MeasureSettings, MeasureTask
from ..tasks.surfaces import ComputeError, Surface, naming, scene_unit
from ..ui.facts import deviation_texts
from ..ui.lengths import IMPERIAL, METRIC, printable
from .adaptive_operator import MakingOperator, make_unplaced, making_fault
from .mesh_operators import LongOperator, Steps, Work
from .place_results import NewMesh
from .refusals import hidden_fault, refuse, still_there
from .scene_objects import edit_mode_left

# The files in the folder that the two Blenders share.
REQUEST, REPORT, LOG = "request", "report.json", "log.txt"

SECONDS_BETWEEN_LOOKS = 0.05

UNIT_OF_FORMAT = "FORMAT"
UNIT_ITEMS = (
    (UNIT_OF_FORMAT, "As Usual", "Millimetres in .stl files, metres in all others"),
    *((key, key.title(), "") for key in ("MILLIMETERS", "CENTIMETERS", "METERS", "INCHES", "FEET")),
)


class WrittenPart(NamedTuple):
    """An object in a written file: its limit surface, the least number of triangles in the file, the number of faces of
    its own mesh, and the facts of its adaptive mesh."""

    task: MeasureTask
    triangles: int
    faces: int
    facts: AdaptiveFacts


@dataclass(frozen=True)
class Written:
    """A written file, and everything to measure it with.

    path: of the file; place: where it goes. source: the .blend file, if it has been saved. unit: of the file, scene: of
    the surfaces, in metres. settings: of the meshes, by their names; measuring: of the measurement. lost: data that the
    file does not hold.
    """

    path: Path
    place: Path
    source: Path | None
    unit: float
    scene: float
    settings: dict[str, Any]
    measuring: MeasureSettings
    parts: dict[str, WrittenPart]
    lost: tuple[str, ...]


class CCDEPTH_OT_export_within(MakingOperator):
    """Write meshes of the selected objects within the tolerance to a file, and measure the file. The scene stays as it
    is. The suffix of the name decides the format"""

    bl_idname = "ccdepth.export_within"
    bl_label = "Export Within Tolerance"
    bl_options: ClassVar[set[str]] = set()

    filepath: StringProperty(name="File", subtype="FILE_PATH")
    filter_glob: StringProperty(default=";".join(f"*{each}" for each in WRITERS), options={"HIDDEN"})
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    unit: EnumProperty(name="Unit", description="The length of one unit in .stl, .obj and .ply files", items=UNIT_ITEMS)
    certificate: BoolProperty(
        name="Certificate",
        description="Write a report in JSON beside the file, which names the file, the saved .blend file, the proved "
        "and the measured distances, and can be checked again by the command line",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath:
            folder = Path(bpy.data.filepath).parent if bpy.data.filepath else Path.home()
            self.filepath = str(folder / f"{bpy.path.clean_name(chosen(context)[0].name)}.stl")
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        unit = column.column()
        unit.active = Path(self.filepath).suffix.lower() in UNITS
        unit.prop(self, "unit")
        column.prop(self, "certificate")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run with progress from the file browser, and at once from a script."""
        return LongOperator.invoke(self, context, None) if self.options.is_invoke else super().execute(context)

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        place = Path(bpy.path.abspath(self.filepath)).absolute()
        with _refusing():
            self._refuse_impossible(place)
            objects = chosen(context)
            refuse(objects, self._fault)
            with TemporaryDirectory() as name, written_there(place, overwrite=True) as path:
                folder, written = Path(name), (yield from self._write(context, objects, path, place))
                (folder / REQUEST).write_bytes(pickle.dumps(written))
                yield from _measured(folder, place)
                report = (folder / REPORT).read_text(encoding="utf-8")
                [entry] = json.loads(report)["files"]
                if entry["error"] is not None:
                    raise CommandError(entry["error"])
            if self.certificate:
                with written_there(_certificate(place), overwrite=True) as path:
                    path.write_text(report, encoding="utf-8")
        self._tell(context, place, entry)
        return {"FINISHED"}

    def _refuse_impossible(self, place: Path) -> None:
        """Raise CommandError for a place that cannot be written to, and for a certificate without a saved file."""
        if place.suffix.lower() not in WRITERS:
            raise CommandError(f"{place}: its name must end in {names_of([*WRITERS])}")
        writer(place)
        for each in (place, *([_certificate(place)] if self.certificate else [])):
            refuse_place(each, overwrite=True)
        # In the background every file counts as changed.
        if self.certificate and (not bpy.data.filepath or (bpy.data.is_dirty and not bpy.app.background)):
            raise CommandError("Save the .blend file first: a certificate names it, so that it can be checked again")

    def _fault(self, blender_object: bpy.types.Object) -> str | None:
        source = result_record.control_object(blender_object)
        if self.certificate and source != blender_object:
            return f"it is a result, and a certificate is about sources: select “{source.name}”"
        is_allowed = bpy.context.scene.ccdepth.subdivide_results
        if source == blender_object and result_record.is_adaptive(blender_object) and not is_allowed:
            return "it is a result without a source; turn Subdivide Results on to subdivide it once more"
        return hidden_fault(blender_object) or making_fault(blender_object, source, self)

    def _write(
        self, context: bpy.types.Context, objects: list[bpy.types.Object], path: Path, place: Path
    ) -> Steps[Written]:
        """Make and write the meshes; nothing of them is left in the open file. Raises ComputeError and CommandError."""
        sources = [result_record.control_object(each) for each in objects]
        lost = leave_out_shading(self, sources, place)
        counted, settings = self.know(context, objects, sources), self.settings()
        with edit_mode_left(context):
            tasks = yield from prepare_adaptive(context, sources, settings, objects)
            made, notes = yield from make_unplaced(context, tasks, self, settings, counted)
            try:
                yield f"Writing {place.name}"
                # Another scene unit would be another length of everything.
                unit, scene = unit_of(place, self._unit()), scene_unit(context.scene)
                parts, more = _written(context, made, self.use_modifiers, path, scene / unit)
            finally:
                bpy.data.batch_remove(meshes_with([each.mesh_uid for each in made]))
        for note in notes:
            self.report({"WARNING"}, printable(note))
        holder = context.scene.ccdepth
        measuring = MeasureSettings.of(self, self.tolerance, accuracy=holder.accuracy, time_limit=0.0)
        source = Path(bpy.data.filepath) if bpy.data.filepath else None
        values = Settings.of(self, result_record.SETTINGS).values
        return Written(path, place, source, unit, scene, values, measuring, parts, lost + more)

    def _unit(self) -> float | None:
        unit = {**METRIC, **IMPERIAL}.get(self.unit)
        return None if unit is None else float(unit.length)

    def _tell(self, context: bpy.types.Context, place: Path, entry: dict[str, Any]) -> None:
        """Report the measured file."""
        unit = scene_unit(context.scene)
        worst = max(entry["objects"], key=lambda each: each["measured"]["proved"] / each["tolerance"])
        proved = nextafter(worst["measured"]["proved"] / unit, inf)
        lengths = proved, worst["measured"]["reached"] / unit, worst["tolerance"] / unit
        most, _, tolerance = deviation_texts(context.scene, *lengths, worst["factors"])
        triangles = sum(each["triangles"] for each in entry["objects"])
        text = (
            f"{printable(place.name)}: {triangles:,} triangles, at most {most} from the surface (measured in the file)"
        )
        if entry["lost"]:
            self.report({"INFO"}, f"{printable(place.name)} does not hold: {', '.join(entry['lost'])}")
        if all(each["met"] for each in entry["objects"]):
            self.report({"INFO"}, text)
        else:
            self.report({"WARNING"}, f"{text}, and not within the tolerance of {tolerance}")


def leave_out_shading(holder: Any, objects: Iterable[bpy.types.Object], place: Path) -> tuple[str, ...]:
    """Turn the shading angle of an operator or a scene off for a format without normals; returns what objects with
    smooth faces thereby lose."""
    if place.suffix.lower() not in WITHOUT_NORMALS:
        return ()
    is_lost = holder.shading_angle > 0 and any(smooth_faces(each.data).any() for each in objects)
    holder.shading_angle = 0.0
    return (SHADING_LOST,) if is_lost else ()


def _certificate(place: Path) -> Path:
    """The place of the certificate of a file."""
    return place.with_name(f"{place.name}.json")


@contextmanager
def _refusing() -> Iterator[None]:
    """Raise what keeps a file from being written as ComputeError."""
    try:
        yield
    except (CommandError, OSError) as fault:
        raise ComputeError(str(fault)) from fault


def _written(
    context: bpy.types.Context, made: list[NewMesh], use_modifiers: bool, path: Path, scale: float
) -> tuple[dict[str, WrittenPart], tuple[str, ...]]:
    """Write meshes in the place of their objects, with the modifiers that they do not replace; returns the objects by
    name, and the data that the file does not hold. Raises ComputeError and CommandError."""
    wanted: dict[bpy.types.Object, tuple[bpy.types.Mesh, list[bpy.types.Modifier]]] = {}
    parts: dict[str, WrittenPart] = {}
    for each in made:
        [mesh] = meshes_with([each.mesh_uid])
        task = each.answer.task
        for user, target in zip(still_there([one.user for one in task.targets]), task.targets, strict=True):
            [source] = still_there([target.source])
            replaced = applied_modifiers(user, use_modifiers=use_modifiers)
            replaced += left_out_sculpting(user, use_modifiers=use_modifiers)
            wanted[user] = mesh, [modifier for modifier in user.modifiers if modifier not in replaced]
            parts[user.name] = WrittenPart(
                _surface(context, target.surface, user), 0, len(source.data.polygons), AdaptiveFacts.of(mesh)
            )
    if len(parts) < len(wanted):
        raise ComputeError("Two of the objects have the same name: rename one, as files know objects by their names")
    with with_other_meshes(context, wanted) as copies, context.temp_override(area=None, region=None):
        for name, copy in zip(parts, copies, strict=True):
            with naming(name):
                triangles = triangles_in(path, read_shown_mesh(context, copy).triangles)
            parts[name] = parts[name]._replace(triangles=triangles)
        lost = write_meshes(dict(zip(parts, copies, strict=True)), path, scale)
    return parts, lost


def _surface(context: bpy.types.Context, surface: Surface, user: bpy.types.Object) -> MeasureTask:
    """The limit surface in the place of its object, to measure against."""
    depsgraph = context.evaluated_depsgraph_get()
    place = np.array(user.evaluated_get(depsgraph).matrix_world, dtype=np.float64)
    return MeasureTask(surface, place[:3, 3], False, [])


def _measured(folder: Path, place: Path) -> Steps[None]:
    """Let another Blender measure the file, and write its report. Raises CommandError if it writes none."""
    with (folder / LOG).open("wb") as log:
        # The add-on may be on in this session alone. This Blender's own options may run a script, or open a file.
        root = __package__.removesuffix(".operators").removesuffix(".ccdepth_addon")
        command = [*own_process("-b", "--addons", root), "--written", str(folder)]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)
    try:
        yield Work(partial(_wait, process), lambda seconds: f"Measuring {place.name}: {seconds:.0f} s")
    finally:
        process.kill()
        process.wait()
    if not (folder / REPORT).exists():
        raise CommandError(end_of(process, folder / LOG))


def _wait(process: subprocess.Popen[bytes], progress: Progress) -> None:
    """Wait for the end of a process. progress: receives the seconds so far, and may raise to stop."""
    begin = monotonic()
    while process.poll() is None:
        progress(monotonic() - begin)
        sleep(SECONDS_BETWEEN_LOOKS)
