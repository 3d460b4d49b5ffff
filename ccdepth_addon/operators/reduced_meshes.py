# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive answers → meshes of as few triangles as can be proved to be within the tolerance."""

from __future__ import annotations

from functools import partial

import bpy
import numpy as np

from ..core import FloatArray, Proof, Reduction
from ..exchange.blender_arrays import read_values
from ..exchange.custom_normals import write_normals
from ..exchange.data_blocks import meshes_with, removed_on_failure
from ..exchange.decimation import Decimation
from ..exchange.face_values import DEPTH, DEPTH_KIND, write_face_values
from ..exchange.mesh_arrays import geometry_checksum
from ..exchange.vertex_groups import has_groups
from ..state import mesh_values
from ..tasks.adaptive_task import AdaptiveAnswer, AdaptiveSettings, AdaptiveTask
from ..tasks.reduce_task import depths_of_faces, finer_answer, reduction_of, triangle_count
from ..tasks.surfaces import naming
from .mesh_operators import Steps, Work
from .place_results import NewMesh, make_meshes

# The number of times that thinning is tried again, without the places of too distant lines.
ROUNDS_FOR_LINES = 4


class Reducer:
    """A maker of reduced meshes, one after the other. notes: for the user."""

    def __init__(self, context: bpy.types.Context, settings: AdaptiveSettings, *, exact_normals: bool) -> None:
        self.notes: list[str] = []
        self._context, self._settings, self._exact_normals = context, settings, exact_normals

    def make(self, answers: list[AdaptiveAnswer]) -> Steps[list[NewMesh]]:
        """The meshes of all answers, or none; yields the stage. Without a gain a mesh is the adaptive mesh itself.
        Raises ComputeError if an object has changed since it was read."""
        made: list[NewMesh] = []
        with removed_on_failure([]) as uids:
            for answer in answers:
                reduced = yield from self._reduced(answer)
                if reduced is None:
                    name = answer.task.object_names[0]
                    self.notes.append(f"{name}: nothing could be reduced; this is the mesh without Reduce")
                    (reduced,) = yield from self._unreduced(answer, exact_normals=self._exact_normals)
                made.append(reduced)
                uids.append(reduced.mesh_uid)
        return made

    def _unreduced(self, answer: AdaptiveAnswer, *, exact_normals: bool) -> Steps[list[NewMesh]]:
        return (yield from make_meshes(self._context, [answer], self._settings, exact_normals=exact_normals))

    def _reduced(self, answer: AdaptiveAnswer) -> Steps[NewMesh | None]:
        """The reduced mesh of an answer; None without fewer triangles, or above the largest number of faces."""
        text = "Subdividing finer, to be reduced: {:,.0f} faces so far".format
        start = yield Work(partial(finer_answer, answer, self._settings), text)
        # Normals are stored at the end, as merging interpolates them across creases.
        (made,) = yield from self._unreduced(start, exact_normals=False)
        with removed_on_failure([made.mesh_uid]) as uids, naming(answer.task.object_names[0]):
            [mesh] = meshes_with(uids)
            write_face_values(mesh, {DEPTH_KIND: depths_of_faces(answer, start.adaptive)})
            bounds = yield from self._reduce(answer, mesh)
            most = min(triangle_count(answer) - 1, self._settings.max_faces)
            if bounds is None or len(bounds) > most:
                bpy.data.batch_remove(meshes_with(uids))
                return None
            depths = read_values(mesh.attributes[DEPTH].data, "value", np.int32)
            mesh_values.write_adaptive(mesh, answer, self._settings, depths, *_proved(answer.task, bounds))
            mesh.ccdepth.unreduced_triangles = triangle_count(answer)
            return NewMesh(answer, mesh.session_uid, geometry_checksum(mesh), depths, made.sources)

    def _reduce(self, answer: AdaptiveAnswer, mesh: bpy.types.Mesh) -> Steps[FloatArray | None]:
        """Reduce a mesh without shape keys; returns the proved distances of its triangles (T,), as of ``Proof``, or
        None, with the mesh unchanged, without a proof."""
        task = answer.task
        decimation = Decimation(mesh, task.control.world, task.surface.tolerance)
        try:
            start = decimation.current()
            search = yield Work(partial(reduction_of, answer, self._settings, start), "Reducing".format)
            yield from self._thin_lines(search, decimation)
            found = yield from self._search(search, decimation)
            if found is not None:
                places = yield Work(partial(search.places, found.mesh), "Reducing".format)
                decimation.write(mesh, places)
                if self._exact_normals and task.is_smooth.any():
                    normals = yield Work(partial(search.normals, found.mesh), "Reducing".format)
                    # Normals go into the scene by the cofactors, whose inverse is the transpose over the determinant.
                    in_object = normals.reshape(-1, 3) @ task.control.world / np.linalg.det(task.control.world)
                    in_object /= np.linalg.norm(in_object, axis=1, keepdims=True)
                    write_normals(mesh, in_object, deformable=has_groups(mesh))
        finally:
            decimation.remove()
        return None if found is None else found.bounds

    def _thin_lines(self, search: Reduction, decimation: Decimation) -> Steps[None]:
        """Remove superfluous vertices of lines, and fix the others."""
        lines = np.unique(np.concatenate([decimation.lines(), decimation.borders()]), axis=0)
        may_go = np.ones(len(search.current.positions), dtype=bool)
        for _ in range(ROUNDS_FOR_LINES if len(lines) else 0):
            yield "Reducing seams and borders"
            thinner = decimation.attempt_thinner(lines, may_go)
            beyond = yield Work(partial(search.beyond, thinner), "Reducing seams and borders".format)
            if not beyond.any():
                decimation.accept(keep=False)
                break
            may_go &= ~beyond
        current = decimation.current()
        is_fixed = np.zeros(len(current.positions), dtype=bool)
        is_fixed[decimation.lines()] = True
        search.begin_with(current, is_fixed)

    def _search(self, search: Reduction, decimation: Decimation) -> Steps[Proof | None]:
        """Reduce step by step; returns the kept proof, or None without a proof."""
        while (attempt := search.attempt()) is not None:
            before = f"Reducing: {len(search.current.corners):,} triangles"
            yield before
            made = decimation.attempt(attempt.triangles, attempt.is_fixed)
            text = f"{before}, {len(made.corners):,} tried"
            if (yield Work(partial(search.judge, made), text.format)):
                decimation.accept(keep=search.is_proved)
        text = f"Reducing: {len(search.current.corners):,} triangles, being proved"
        proof = yield Work(search.prove, text.format)
        if search.is_proved:
            decimation.keep()
        return proof


def _proved(task: AdaptiveTask, bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The proved distances (T,) of triangles with these bounds, and their ratios (T,) to the tolerance at the place."""
    factors = task.surface.factors
    ratios = (bounds + task.allowance / task.surface.least_factor) / task.surface.tolerance
    return bounds * (1.0 if factors is None else factors[1]), ratios
