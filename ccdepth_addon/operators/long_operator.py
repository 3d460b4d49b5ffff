# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""What operators that compute something with a tolerance share: their settings, and runs that leave the window free."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, TypeVar

import bpy
import numpy as np
from bpy.props import FloatProperty

from ..core import Progress
from ..state import properties, refusals
from ..tasks.stepwise import Stage, Stepwise
from ..tasks.surfaces import ComputeError
from ..ui import progress_bar
from ..ui.printable import printable_lines
from . import worker
from .selected_meshes import count_text, poll_meshes

Answer = TypeVar("Answer")

# Seconds of work before Blender handles events: at the start, and at each tick of the timer. While a thread computes, a
# tick lasts no longer than one look at it.
PATIENCE_AT_START = 0.2
PATIENCE_AT_EACH_TICK = worker.SECONDS_TO_WAIT
SECONDS_BETWEEN_TICKS = 0.01

REMEDY = "Select Invalid Faces selects what is at fault, and Repair Mesh removes it"

# While it runs, the view may be moved.
NAVIGATION_EVENTS = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM"}


class LongOperator(properties.ToleranceProperties, bpy.types.Operator):
    """An operator that works in steps: at once from a script; from the window with progress, and Esc cancels it.

    Steps read and write Blender's data; what is computed in between runs in a thread, so that the window stays free.

    Settings that the caller does not set come from the scene, which has them under the same names.
    """

    # None unless it runs: Blender keeps operators that have run, and would keep their work with them.
    _run: Stepwise[Any, Any] | None = None

    tolerance: properties.absolute_tolerance_property()
    # The same number for the redo panel, where a fraction of the diagonal must not be shown in metres.
    relative_tolerance: FloatProperty(
        name="Tolerance",
        description=properties.RELATIVE_DESCRIPTION,
        precision=6,
        step=0.01,
        soft_min=1e-6,
        soft_max=0.1,
        get=lambda self: self.tolerance,
        set=lambda self, value: setattr(self, "tolerance", value),
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return poll_meshes(cls, context)

    def start(self, context: bpy.types.Context) -> Generator[Any, None, Any]:
        """Read the objects, and return the work as steps that yield its progress. Raises ComputeError."""
        raise NotImplementedError

    def computed(self, work: Callable[[Progress], Answer]) -> Generator[float, None, Answer]:
        """Do work that needs nothing of Blender, as steps that yield its progress. Raises what it raises, and
        ComputeError where it was stopped."""
        run = worker.in_thread if self.options.is_invoke and not bpy.app.background else worker.at_once
        try:
            return (yield from run(work))
        except worker.Cancelled as stopped:
            raise ComputeError(f"{self.bl_label} was stopped, and nothing was changed") from stopped

    def finish(self, context: bpy.types.Context, answer: Any) -> set[str]:
        """Write the answer, all of it or nothing. Raises ComputeError."""
        raise NotImplementedError

    def progress_text(self, progress: Any) -> str:
        """The progress for the status bar."""
        raise NotImplementedError

    def fraction_done(self, progress: Any) -> float | None:
        """The part of the work that is done: the progress itself, unless that is something else; None where nobody
        knows how much work there is."""
        return float(progress)

    def report_skipped(self, context: bpy.types.Context) -> None:
        """Report how many selected objects have no mesh, if there are any."""
        skipped = sum(obj.type != "MESH" for obj in context.selected_objects)
        if skipped:
            objects = count_text(skipped, "selected object", "selected objects")
            self.report({"INFO"}, f"Skipped {objects} without a mesh")

    def leave(self, context: bpy.types.Context) -> None:
        """Put back what ``start`` changed while it runs; called however it ends."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._begin(context, np.inf) or {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ended = self._begin(context, np.inf if bpy.app.background else PATIENCE_AT_START)
        if ended:
            return ended
        self._timer = context.window_manager.event_timer_add(SECONDS_BETWEEN_TICKS, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("WAIT")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self.cancel(context)
            self.report({"INFO"}, f"{self.bl_label} was cancelled, and nothing was changed")
            return {"CANCELLED"}
        if event.type == "TIMER":
            try:
                ended = self._go_on(context, PATIENCE_AT_EACH_TICK)
            except BaseException:
                self._stop_waiting(context)
                raise
            if ended:
                self._stop_waiting(context)
                return ended
            progress_bar.show(context, self._status(), self._fraction())
        return {"PASS_THROUGH"} if event.type in NAVIGATION_EVENTS else {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        self._stop_waiting(context)
        if self._run is not None:
            self._run.give_up()
        self._end(context)

    def _status(self) -> str:
        progress = None if self._run is None else self._run.progress
        if isinstance(progress, Stage):
            return progress.text
        return self.bl_label if progress is None else self.progress_text(progress)

    def _fraction(self) -> float | None:
        progress = None if self._run is None else self._run.progress
        return None if progress is None or isinstance(progress, Stage) else self.fraction_done(progress)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "tolerance_mode")
        layout.prop(self, "relative_tolerance" if self.tolerance_mode == "RELATIVE" else "tolerance")
        for name in properties.setting_names(type(self)):
            if name != "tolerance_mode" and (name != "frame_list" or self.frames == "CUSTOM"):
                layout.prop(self, name)

    def _begin(self, context: bpy.types.Context, seconds: float) -> set[str] | None:
        self._take_settings(context.scene.ccdepth)
        return self._go_on(context, seconds)

    def _go_on(self, context: bpy.types.Context, seconds: float) -> set[str] | None:
        """Work for so long; returns what the operator returns at its end, and None before."""
        try:
            if self._run is None:
                self._run = Stepwise(self.start(context))
            if not self._run.work(seconds):
                return None
            outcome = self.finish(context, self._run.answer)
        except ComputeError as fault:
            return self._refuse(context, fault)
        except MemoryError:
            return self._refuse(context, ComputeError("There is not enough memory for it: nothing was changed"))
        except BaseException:
            self._end(context)
            raise
        self._end(context)
        refusals.note({})
        if self.options.is_repeat:
            self._keep_settings(context.scene.ccdepth)
        return outcome

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        self._end(context)
        refusals.note(fault.faces_at_fault)
        text = f"{fault}\n{REMEDY}" if fault.faces_at_fault else str(fault)
        self.report({"ERROR"}, printable_lines(text))
        return {"CANCELLED"}

    def _end(self, context: bpy.types.Context) -> None:
        self._run = None
        self.leave(context)

    def _stop_waiting(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        progress_bar.hide(context)
        # There is none when Blender is closed.
        if context.window is not None:
            context.window.cursor_modal_restore()

    def _take_settings(self, settings: bpy.types.PropertyGroup) -> None:
        """Read from the scene what the caller did not set."""
        for name in properties.setting_names(type(self)):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(settings, name))
        if not self.properties.is_property_set("tolerance"):
            self.tolerance = getattr(settings, properties.tolerance_name(self.tolerance_mode))

    def _keep_settings(self, settings: bpy.types.PropertyGroup) -> None:
        """Write to the scene what was chosen in the redo panel."""
        for name in properties.setting_names(type(self)):
            setattr(settings, name, getattr(self, name))
        properties.set_scene_tolerance(settings, self.tolerance)
