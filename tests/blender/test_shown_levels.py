# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender shows after Set Subdivision Levels, with the modifier as it was set: within the tolerance everywhere.

The reference is the same modifier with Use Limit Surface off, some levels deeper, and its vertices' limit positions.
Blender's single precision is measured against the law for it (``rounding.modifier_rounding``).
"""

from collections.abc import Callable
from itertools import cycle, product

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from benchmarks.single_precision import MOST, SHAPES, random_offsets, ratios
from tests import meshes
from tests.blender import addon, scene
from tests.blender.measuring import BlenderLevels, quad_count, rounding
from tests.blender.named_meshes import NAMED
from tests.brute_force import Levels
from tests.thorough import cases, each

# Levels between those of the facets and of the reference, as far as quads of the reference allow, and one at least.
MOST_DEEPER = 2
MOST_QUADS = 250_000

# In parts of the diagonal. The finer one is left where its levels make too many quads.
TOLERANCES = (0.05, 0.004)


def darts(data: Callable[[], meshes.MeshData], crease: float) -> Callable[[], meshes.MeshData]:
    """One creased edge, from vertex 0 inside the mesh."""
    return lambda: meshes.creased(data(), {tuple(data().edges[0].tolist()): crease})


CREASED: dict[str, Callable[[], meshes.MeshData]] = {
    **{f"upper edges {c}": (lambda c=c: meshes.cube_creased_around_the_top(c)) for c in (0.3, 0.7, 0.9, 1.0)},
    **{
        f"dart {crease} at valence {n}": darts(lambda n=n: meshes.fan(n, 2), crease)
        for crease in (0.8, 1.0)
        for n in (3, 4, 7)
    },
    "vertex creases": meshes.corner_creased_cube,
    "vertex creases on corners": lambda: meshes.creased(meshes.landscape(4, 4), {}, {0: 0.9, 4: 0.3, 12: 0.7}),
    "open and closed creases": meshes.creased_cube,
    # More than the core has tables for.
    "valence 72": lambda: meshes.fan(72, 1),
}
MESHES = NAMED | CREASED

SETTINGS = ("CONTROL", "LIMIT"), ("ALL", "PRESERVE_CORNERS")

# Every second mesh once, or not where it takes long.
ONCE = zip([*MESHES][::2], cycle(product(*SETTINGS)), strict=False)
SHORT = [(name, *setting) for name, setting in ONCE if name != "valence 360"]


@pytest.mark.parametrize(
    ("name", "vertices", "boundary"), cases(product(MESHES, *SETTINGS), SHORT, product(CREASED, *SETTINGS))
)
def test_what_is_shown_is_within_the_tolerance(name: str, vertices: str, boundary: str) -> None:
    data = meshes.single_precision(MESHES[name]())
    diagonal = meshes.diagonal(data)
    shown, reference = BlenderLevels(data, boundary), BlenderLevels(data, boundary)
    modifier, measured = shown.object.modifiers[0], 0
    law = addon.module("core.bounds.rounding").modifier_rounding
    for share in TOLERANCES:
        tolerance = share * diagonal
        addon.compute(shown.object, tolerance=tolerance, method="CERTIFIED", vertices=vertices, use_modifiers=False)
        modifier.use_limit_surface, modifier.quality = vertices == "CONTROL", 1
        # Whoever asks for it sets what is finer than is measured here.
        bpy.context.scene.ccdepth.max_faces = 2**31 - 1
        level = shown.object.data.ccdepth.uniform_level
        deeper = [more for more in range(1, MOST_DEEPER + 1) if quad_count(data, level + more) <= MOST_QUADS]
        if not deeper:
            continue
        assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
        assert (modifier.levels, modifier.use_limit_surface) == (level, vertices == "LIMIT")
        # Bilinear facets against the limit surface at the same parameters.
        far = np.linalg.norm(reference.offsets(shown.shown(level), level, deeper[-1]), axis=1).max()
        slack = sum(law(reference.subdivided(0), each) for each in (level, level + deeper[-1]))
        slack += rounding(data.positions, level + deeper[-1])
        assert far <= tolerance + slack, (level, modifier.quality, far / tolerance)
        measured += 1
    assert measured
    shown.remove()
    reference.remove()


# The law of single precision, two thirds of which are never exceeded


@pytest.mark.every_blender
@pytest.mark.parametrize("stretch", each((1.0, 20.0, 100.0, 1e4), short=(20.0, 100.0)))
@pytest.mark.parametrize("offset", each(((300, 300, 300), (300, -300, 10)), short=[(300, 300, 300)]))
def test_sheared_objects(offset: tuple[float, float, float], stretch: float) -> None:
    """The scene may take away most of the coordinates that Blender rounds."""
    data = meshes.single_precision(meshes.moved(scene.suzanne(), *offset))
    shown = BlenderLevels(data, "ALL")
    exact = Levels(shown.subdivided(0))
    # Turned under a parent that is stretched.
    child, parent = scene.add_object(data), scene.add_object(meshes.cube())
    child.matrix_basis = Euler((0, 0, np.pi / 4)).to_matrix().to_4x4()
    child.parent, parent.matrix_basis = parent, Matrix.Diagonal((stretch, 1, 1, 1))
    bpy.context.view_layer.update()
    control = addon.module("exchange.control_mesh").read_alone(bpy.context, child, use_modifiers=False)
    law = addon.module("core.bounds.rounding").modifier_rounding
    for level in (1, 2):
        off = (shown.shown(level) - exact.mesh(level).positions) @ control.world.T
        assert np.linalg.norm(off, axis=1).max() <= MOST * law(control.in_world, level)


# In the short suite the worst that were found.
CASES = each(
    [
        *((name, size, level) for name in SHAPES for size in (3, 5, 23, 40, 48, 61, 96) for level in (1, 2)),
        *(("fan", size, level) for size in (3, 4, 5, 16) for level in (3, 4)),
    ],
    short=[
        *(("prism", 48, 1), ("prism", 40, 1), ("fan", 96, 2), ("bipyramid", 61, 2), ("wheel", 23, 1)),
        *(("fan", size, 4) for size in (3, 4, 5)),
    ],
)


@pytest.mark.every_blender
@pytest.mark.parametrize("case", CASES)
def test_errors_are_at_most_two_thirds_of_the_law(case: tuple[str, int, int]) -> None:
    name, size, level = case
    found = ratios(SHAPES[name](size), level, random_offsets(6, seed=size))
    assert max(found.values()) <= MOST
