# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""The common bases of operators on meshes: quick ones, and long ones with a tolerance, which leave the window free.

A long run is a generator of steps: it yields the next step as a text, or work without Blender, and receives the work's
answer. A job runs all steps at once, or for a while at a time with the work in a thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from math import inf
from time import perf_counter
from typing import Any, ClassVar, Generic, TypeVar, cast

import bpy

from ..core import Progress
from ..state import known, properties
from ..state.chosen import chosen
from ..tasks.surfaces import ComputeError
from ..ui import sidebar
from ..ui.lengths import count_text, printable_lines

Answer = TypeVar("Answer")

# Seconds between looks at a thread.
SECONDS_TO_WAIT = 0.02

# Seconds of work before Blender handles events: at the start, and at each tick of the timer. While a thread computes, a
# tick lasts no longer than one look at it.
PATIENCE_AT_START = 0.2
PATIENCE_AT_EACH_TICK = SECONDS_TO_WAIT
SECONDS_BETWEEN_TICKS = 0.01

REMEDY = "Select Invalid Faces selects the faces at fault, and Repair Mesh repairs the mesh"

DELETED = "An object was deleted in the meantime: nothing was written"

# While it runs, the view may be moved.
NAVIGATION_EVENTS = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM"}


class Cancelled(Exception):
    """The error that the progress function raises in abandoned work."""


@dataclass(frozen=True)
class Work:
    """Work without Blender. text: of its progress. total: the progress at its end, if known."""

    function: Callable[[Progress], Any]
    text: Callable[[float], str]
    total: float | None = None


Steps = Generator[str | Work, Any, Answer]


class Job(Generic[Answer]):
    """The steps, their progress, and the answer at their end."""

    def __init__(self, steps: Steps[Answer], *, in_threads: bool = False) -> None:
        self.answer: Answer | None = None
        self.is_done = False
        self._steps, self._in_threads = steps, in_threads
        self._step: str | Work | None = None
        self._thread: _Thread | None = None

    @property
    def text(self) -> str | None:
        """The next step in words, or the progress of the work."""
        return self._step.text(self._progress) if isinstance(self._step, Work) else self._step

    @property
    def is_working(self) -> bool:
        """Whether work without Blender is going on; temporary data in the file are then outside all scenes."""
        return isinstance(self._step, Work)

    @property
    def fraction(self) -> float | None:
        """The fraction of the work done, if known."""
        total = self._step.total if isinstance(self._step, Work) else None
        return min(self._progress / total, 1.0) if total else None

    @property
    def _progress(self) -> float:
        return 0.0 if self._thread is None else self._thread.progress

    def run(self, seconds: float = inf) -> bool:
        """Go on for a number of seconds; True when done. Raises errors of the steps and their work."""
        until = perf_counter() + seconds
        while not self.is_done and perf_counter() < until:
            if not isinstance(self._step, Work):
                self._go_on(self._steps.send, None)
            elif self._thread is None:
                self._thread = _Thread(self._step.function)
                (self._thread.start if self._in_threads else self._thread.run)()
            elif self._thread.is_alive():
                self._thread.join(SECONDS_TO_WAIT)
            else:
                thread, self._thread = self._thread, None
                # The steps may clean up after a fault.
                if thread.fault is not None:
                    self._go_on(self._steps.throw, thread.fault)
                else:
                    self._go_on(self._steps.send, thread.answer)
        return self.is_done

    def _go_on(self, resume: Callable[[Any], str | Work], given: Any) -> None:
        try:
            self._step = resume(given)
        except StopIteration as finished:
            self.answer, self.is_done = finished.value, True

    def give_up(self) -> None:
        """End the unfinished work, and free what it holds."""
        if self._thread is not None:
            self._thread.is_wanted = False
        self._steps.close()


def answer_of(steps: Steps[Answer]) -> Answer:
    """The answer of steps, run at once. Raises their errors."""
    job = Job(steps)
    job.run()
    return cast(Answer, job.answer)


class _Thread(threading.Thread):
    """Work, its progress, and its end; begun in a thread, or done at once."""

    def __init__(self, function: Callable[[Progress], Any]) -> None:
        super().__init__(name="CC Depth")
        self.progress = 0.0
        self.answer: Any = None
        self.fault: BaseException | None = None
        self.is_wanted = True
        self._function = function

    def run(self) -> None:
        _threads.add(self)
        try:
            self.answer = self._function(self._report)
        except BaseException as fault:
            self.fault = fault
        finally:
            _threads.discard(self)

    def _report(self, progress: float) -> None:
        if not self.is_wanted:
            raise Cancelled
        self.progress = progress


_threads: set[_Thread] = set()


def stop_all() -> None:
    """Cancel all work, and wait for its end."""
    for thread in list(_threads):
        thread.is_wanted = False
        thread.join()


class MeshOperator(bpy.types.Operator):
    """An operator on mesh objects; unless it says otherwise it is one step of undo, and can be adjusted.

    not_in_edit_mode: the reason why it does not work in Edit Mode, if any.
    """

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    not_in_edit_mode: ClassVar[str] = ""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        """The missing thing that the operator needs, if any; asked for if meshes are selected."""
        return None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        run = sidebar.running()
        if run is not None:
            fault: str | None = f"{run.label} is running; Esc or its Cancel ends it"
        elif cls.not_in_edit_mode and context.mode != "OBJECT":
            fault = cls.not_in_edit_mode
        elif context.mode not in {"OBJECT", "EDIT_MESH"}:
            fault = "Works in Object Mode and in Edit Mode"
        else:
            fault = cls.missing(context) if chosen(context) else "Select a mesh object"
        if fault:
            cls.poll_message_set(fault)
        return not fault


class QuickOperator(MeshOperator):
    """An operator that works on meshes without a pause, and reports refusals."""

    def act(self, context: bpy.types.Context) -> set[str]:
        """Do the work; returns the status of ``execute``. Raises ComputeError, with nothing changed."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            return self.act(context)
        except ComputeError as fault:
            self.report({"ERROR"}, printable_lines(str(fault)))
            return {"CANCELLED"}


class LongOperator(properties.ToleranceProperties, MeshOperator):
    """An operator that works in steps: at once from a script; from the window with progress, until Esc cancels the run.

    Settings that the caller does not set come from the scene, under the same names.
    """

    # None unless it runs: Blender keeps operators that have run, and would keep their work with them.
    _run: Job[set[str]] | None = None

    # The session identifiers of the objects without which it is of no use to go on.
    _needed: frozenset[int] = frozenset()

    # The run as the window shows it.
    _shown: sidebar.Run | None = None

    # Whether to save the file as soon as it contains nothing temporary.
    _is_save_wanted = False

    # Without REGISTER: Adjust Last Operation would run all of it again at once, with a dead window.
    bl_options: ClassVar[set[str]] = {"UNDO"}

    tolerance: properties.absolute_tolerance_property()

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        """Read the objects, compute, and write the whole answer or nothing; returns the status of ``execute``. At any
        end of the run, the steps restore everything changed meanwhile. Raises ComputeError."""
        raise NotImplementedError

    def end_without(self, context: bpy.types.Context, objects: Iterable[bpy.types.Object]) -> None:
        """Let the run end as soon as one of these objects is deleted."""
        self._needed = _present(context) & {each.session_uid for each in objects}

    def report_skipped(self, context: bpy.types.Context) -> None:
        """Report the number of selected objects without a mesh, if there are any."""
        skipped = sum(obj.type != "MESH" for obj in context.selected_objects)
        if skipped:
            objects = count_text(skipped, "selected object", "selected objects")
            self.report({"INFO"}, f"Skipped {objects} without a mesh")

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._go_on(context, inf) or {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ended = self._go_on(context, inf if bpy.app.background else PATIENCE_AT_START)
        if ended:
            return ended
        name = "" if "INTERNAL" in self.bl_options else type(self).bl_idname
        self._shown = sidebar.Run(name, self.bl_label)
        self._show_progress(context)
        self._timer = context.window_manager.event_timer_add(SECONDS_BETWEEN_TICKS, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("WAIT")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        assert self._shown is not None
        if event.type == "ESC" or self._shown.is_cancelled:
            self.cancel(context)
            self.report({"INFO"}, f"{self.bl_label} was cancelled, and nothing was changed")
            return {"CANCELLED"}
        if asks_to_save(event):
            self._is_save_wanted = True
        if event.type == "TIMER":
            try:
                ended = self._go_on(context, PATIENCE_AT_EACH_TICK)
            except BaseException:
                self._stop_waiting(context)
                raise
            if ended:
                self._stop_waiting(context)
                return ended
            self._show_progress(context)
            assert self._run is not None
            if self._run.is_working:
                self._save_if_wanted()
        # The mouse may press Cancel.
        is_free = event.type in NAVIGATION_EVENTS or (event.type == "LEFTMOUSE" and sidebar.is_over_tab(context, event))
        return {"PASS_THROUGH"} if is_free else {"RUNNING_MODAL"}

    def _show_progress(self, context: bpy.types.Context) -> None:
        assert self._run is not None
        assert self._shown is not None
        self._shown.text, self._shown.fraction = self._run.text or self.bl_label, self._run.fraction
        sidebar.show_progress(context, self._shown)

    def cancel(self, context: bpy.types.Context) -> None:
        self._stop_waiting(context)
        if self._run is not None:
            self._run.give_up()
        self._end()

    def _go_on(self, context: bpy.types.Context, seconds: float) -> set[str] | None:
        """Work for a while; returns the operator's status at its end, and None before."""
        try:
            if self._run is None:
                self._take_settings(context.scene.ccdepth)
                in_threads = self.options.is_invoke and not bpy.app.background
                self._run = Job(self.steps(context), in_threads=in_threads)
            if not self._needed <= _present(context):
                self._run.give_up()
                raise ComputeError(DELETED)
            if not self._run.run(seconds):
                return None
            outcome = self._run.answer
        except ComputeError as fault:
            return self._refuse(context, fault)
        except Cancelled:
            return self._refuse(context, ComputeError(f"{self.bl_label} was stopped, and nothing was changed"))
        except MemoryError:
            return self._refuse(context, ComputeError("There is not enough memory: nothing was changed"))
        except BaseException:
            self._end()
            raise
        self._end()
        known.note_refused({})
        return outcome

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        self._end()
        known.note_refused(fault.faces_at_fault)
        text = f"{fault}\n{REMEDY}" if fault.faces_at_fault else str(fault)
        self.report({"ERROR"}, printable_lines(text))
        return {"CANCELLED"}

    def _end(self) -> None:
        self._run, self._needed = None, frozenset()
        self._save_if_wanted()

    def _save_if_wanted(self) -> None:
        if self._is_save_wanted:
            self._is_save_wanted = False
            bpy.ops.wm.save_mainfile("INVOKE_DEFAULT")

    def _stop_waiting(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        assert self._shown is not None
        sidebar.hide_progress(context, self._shown)
        # There is none when it is closed.
        if context.window is not None:
            context.window.cursor_modal_restore()

    def _take_settings(self, settings: bpy.types.PropertyGroup) -> None:
        """Read the settings that the caller did not set from the scene."""
        for name in properties.setting_names(type(self)):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(settings, name))
        if not self.properties.is_property_set("tolerance"):
            self.tolerance = getattr(settings, properties.tolerance_name(self.tolerance_mode))


def asks_to_save(event: bpy.types.Event) -> bool:
    """Whether an event is the shortcut for Save; with Shift or Alt it is that of Save As or another one."""
    is_shortcut = (event.ctrl or event.oskey) and not (event.shift or event.alt)
    return bool(event.type == "S" and event.value == "PRESS" and is_shortcut)


def _present(context: bpy.types.Context) -> frozenset[int]:
    """The session identifiers of all objects in the view layer."""
    # Without an update, the list has holes in place of removed objects.
    return frozenset(each.session_uid for each in context.view_layer.objects if each is not None)
