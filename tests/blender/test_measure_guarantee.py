# SPDX-License-Identifier: GPL-3.0-or-later
"""What Measure Deviation proves and reaches, against the distances between dense samples.

Nothing of the core takes part: the surface is Blender's own Subdivision Surface modifier two levels finer and with its
vertices on the limit surface, distances are those of mathutils' BVH tree. From samples on either side to the other one
they are never longer than the true distance, but for how far the fine mesh is from the surface itself.
"""

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np
import pytest
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from ccdepth_addon.core.arrays.types import FloatArray
from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide
from tests.blender.test_adaptive_guarantee import nearest
from tests.thorough import each

# The modifier and the tree compute in single precision: a few ulps of a coordinate.
SINGLE = 2e-6

# Samples do not hit the farthest point: what is reached may be more than what they see, by this part. Distances to a
# smooth surface are flat where they are largest, so that a spacing of a tenth of a face costs a hundredth or so.
SEEN = 1.05


@dataclass(frozen=True)
class Shown:
    """What an object shows, in the scene: positions (V, 3), triangles (T, 3)."""

    positions: FloatArray
    triangles: NDArray[np.int32]

    def tree(self) -> BVHTree:
        return BVHTree.FromPolygons(self.positions.tolist(), self.triangles.tolist())

    def samples(self) -> FloatArray:
        """Vertices, and six points in each triangle."""
        weights = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [1, 1, 0], [0, 1, 1], [1, 0, 1]], dtype=np.float64)
        weights /= weights.sum(axis=1, keepdims=True)
        inside = np.einsum("sc,tcx->stx", weights, self.positions[self.triangles]).reshape(-1, 3)
        return np.concatenate([self.positions, inside])


def shown(holder: bpy.types.Object) -> Shown:
    bpy.context.view_layer.update()
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    positions, triangles = scene.mesh_data(mesh).positions, scene.triangles_of(mesh)
    matrix = np.array(holder.matrix_world, dtype=np.float64)
    evaluated.to_mesh_clear()
    return Shown(positions @ matrix[:3, :3].T + matrix[:3, 3], triangles)


def limit_surface(source: bpy.types.Object, levels: int) -> Shown:
    """The source with so many levels, vertices on the limit surface; its own modifier stays as it is."""
    copy = source.copy()
    bpy.context.scene.collection.objects.link(copy)
    copy.modifiers.clear()
    modifier = scene.add_subdivision(copy, levels)
    modifier.use_limit_surface, modifier.quality = True, 10
    surface = shown(copy)
    bpy.data.objects.remove(copy)
    return surface


def assert_between(measured: bpy.types.Object, source: bpy.types.Object, levels: int, ratio: float = 1.05) -> None:
    """upper ≥ true ≥ lower for the measurement just made, and the two within the accuracy of each other."""
    record = measured.data.ccdepth
    upper, lower = record.deviation, record.deviation_reached
    surface, coarser, mesh = limit_surface(source, levels), limit_surface(source, levels - 1), shown(measured)
    tree = surface.tree()
    single = SINGLE * max(np.abs(mesh.positions).max(), np.abs(surface.positions).max())
    # Its vertices are on the surface, and each level makes its faces four times as good: a third of this is left.
    off = nearest(coarser.tree(), surface.positions)[0].max()
    there = nearest(mesh.tree(), surface.positions)[0].max()
    back = nearest(tree, mesh.samples())[0].max()
    assert upper >= there - single
    assert upper >= back - off - single
    assert lower <= SEEN * max(there, back) + off + single
    # The worst point is really so far: it is on one of the two, and not nearer to the other one.
    worst = record.measurement.worst_point
    to_surface, to_mesh = tree.find_nearest(worst)[3], mesh.tree().find_nearest(worst)[3]
    assert min(to_surface, to_mesh) <= off + single
    assert max(to_surface, to_mesh) >= lower - off - single
    assert record.measurement.accuracy_met
    assert upper <= ratio * lower * (1 + 1e-6)
    assert addon.deviations(measured).max() <= upper


SUZANNE = [(scene.suzanne, levels) for levels in (1, 2, 3, 4)]
SMALL = [(meshes.cube, 1), (meshes.triangles_and_quads, 3)]


@pytest.mark.parametrize("limit", [False, True])
@pytest.mark.parametrize("case", each([*SMALL, *SUZANNE], short=[*SMALL, SUZANNE[0]]))
def test_meshes_at_levels(case: tuple[Callable[[], meshes.MeshData], int], limit: bool) -> None:
    make, levels = case
    holder = scene.add_object(make())
    scene.add_subdivision(holder, levels).use_limit_surface = limit
    addon.measure(holder, time_limit=0.0)
    assert_between(holder, holder, min(levels + 2, 5) if make == scene.suzanne else 5)


def test_decimated() -> None:
    source = scene.add_object(meshes.torus(8, 6))
    scene.add_subdivision(source, 3)
    holder = scene.add_object(scene.evaluated_mesh_data(source), "Decimated")
    holder.modifiers.new("Decimate", "DECIMATE").ratio = 0.1
    addon.measure(holder, source, time_limit=0.0)
    assert_between(holder, source, 5)


ADAPTIVE: dict[str, Callable[[], meshes.MeshData]] = {
    "torus": lambda: meshes.torus(6, 4),
    "creased cube": meshes.creased_cube,
    "triangles and quads": meshes.triangles_and_quads,
}


@pytest.mark.parametrize("name", ADAPTIVE)
def test_adaptive_result(name: str) -> None:
    source = scene.add_object(ADAPTIVE[name]())
    [result] = subdivide(source, tolerance=0.03)
    addon.measure(result, source, time_limit=0.0, tolerance=0.03)
    assert_between(result, source, 6)
    assert result.data.ccdepth.deviation_reached <= 0.03


@pytest.mark.parametrize("far", [0.3, 7.0])
def test_moved_by_a_known_amount(far: float) -> None:
    source = scene.add_object(meshes.cube())
    scene.add_subdivision(source, 4).use_limit_surface = True
    source.location = (3.0, 2.0, 1.0)
    moved = scene.add_object(scene.evaluated_mesh_data(source), "Moved")
    moved.location = (3.0 + far, 2.0, 1.0)
    addon.measure(moved, source, time_limit=0.0)
    assert_between(moved, source, 6)
    # It is the amount itself: the outermost points to either side have nothing nearer. The mesh itself is not exact.
    own = 0.002
    assert moved.data.ccdepth.deviation_reached <= far + own
    assert moved.data.ccdepth.deviation >= far - own
    assert moved.data.ccdepth.deviation <= 1.05 * far + own
