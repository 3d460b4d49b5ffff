# SPDX-License-Identifier: GPL-3.0-or-later
"""The promise itself: no face at its depth is farther from the limit surface than the tolerance, nor than proved.

Measured with levels of Blender's Subdivision Surface modifier, Use Limit Surface off, and nothing of the add-on's but
the last step of a deep level's vertices to their limits (``BlenderLevels``): a point of a facet finds its counterpart,
the one of the same face at the same parameters, in a much deeper level.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np
import pytest

from ccdepth_addon.core.depth.face_depths import METHODS, VERTICES
from tests import meshes
from tests.blender import addon, scene
from tests.blender.measuring import BlenderLevels, rounding
from tests.thorough import combinations

pytestmark = pytest.mark.every_blender

# The surface is refined so many levels below the facets.
DEEPER = 3

# By distance the farthest of a level is less than at equal parameters: benchmarks/least_levels.py.
EQUAL_METHODS = [method for method in METHODS if method != "DISTANCE"]

# Small ones: a level at which all faces are measured has four times as many quads as the one before. Of semi-sharp
# creases half is left, so that their last rule has run out by level 3.
MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "cube": meshes.cube,
    "landscape": lambda: meshes.landscape(4, 3),
    "cylinder": lambda: meshes.cylinder(7),
    "icosphere": lambda: meshes.bumpy(scene.icosphere(1), 0.1),
    "valence 2": meshes.valence_two,
    "valence 12": lambda: meshes.fan(12, 1),
    "creases": lambda: meshes.softened(meshes.with_random_creases(meshes.landscape(4, 4), share=0.3), 0.5),
    "creased cube": lambda: meshes.softened(meshes.corner_creased_cube(), 0.5),
    "two cubes": meshes.two_cubes_sharing_an_edge,
}

# In parts of the diagonal.
TOLERANCES = (0.3, 0.06, 0.012, 0.003)


@pytest.mark.parametrize(("name", "boundary"), combinations(MESHES, ["ALL", "PRESERVE_CORNERS"]))
def test_no_face_at_its_depth_is_farther_than_promised(name: str, boundary: str) -> None:
    data, seen = meshes.single_precision(MESHES[name]()), set()
    diagonal = float(np.linalg.norm(np.ptp(data.positions, axis=0)))
    levels = BlenderLevels(data, boundary)
    distances = cache(lambda depth, vertices: levels.distances(depth, vertices, DEEPER))
    for share, method, vertices in product(TOLERANCES, EQUAL_METHODS, VERTICES):
        addon.compute(levels.object, tolerance=share * diagonal, method=method, vertices=vertices)
        depths, bounds = addon.depths(levels.object), addon.bounds(levels.object)
        assert bounds.max() <= np.float32(share * diagonal)
        for depth in {0, 1, 2, 3} & {*depths.tolist()}:
            # Single precision of the facets, and of the deep level.
            allowed = bounds + 2 * rounding(data, depth + DEEPER)
            assert np.all((distances(depth, vertices) <= allowed)[depths == depth]), (method, vertices, depth)
            seen.add(depth)
    assert seen == {0, 1, 2, 3}
