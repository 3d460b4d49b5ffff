# SPDX-License-Identifier: GPL-3.0-or-later
"""The promise itself: no face at its depth is farther from the limit surface than the tolerance, nor than proved.

Measured with levels of Blender's Subdivision Surface modifier, Use Limit Surface off, and nothing of the add-on's but
the last step of a deep level's vertices to their limits (``BlenderLevels``): a point of a facet finds its counterpart,
the one of the same face at the same parameters, in a much deeper level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from ccdepth_addon.core.depth.face_depths import METHODS, VERTICES
from tests import meshes
from tests.blender import addon, scene
from tests.blender.measuring import BlenderLevels, part_of, quad_count, rounding

# The surface is refined so many levels below the facets; and most quads of that level, which the time goes into.
DEEPER = [4, pytest.param(5, marks=pytest.mark.thorough)]
MOST_QUADS = {4: 150_000, 5: 700_000}

# By distance the farthest of a level is less than at equal parameters: benchmarks/least_levels.py.
EQUAL_METHODS = [method for method in METHODS if method != "DISTANCE"]


def softened(data: meshes.MeshData) -> meshes.MeshData:
    """So that the last semi-sharp rule has run out by level 3."""
    return meshes.softened(data, 0.5)


@dataclass(frozen=True)
class Case:
    """A mesh, the tolerances to ask for, and the depths of which some faces at least have to be measured.

    everywhere: whether it is measured in every Blender; the others, which are there for the bounds, in one.
    """

    build: Callable[[], meshes.MeshData]
    tolerances: tuple[float, ...]
    depths: set[int]
    boundaries: tuple[str, ...] = ("ALL",)
    everywhere: bool = False


BOTH = ("ALL", "PRESERVE_CORNERS")

CASES: dict[str, Case] = {
    "cube": Case(meshes.cube, (1.0, 0.2, 0.03, 0.008), {0, 1, 2, 3}),
    "suzanne": Case(scene.suzanne, (0.5, 0.05, 0.01), {0, 1, 2, 3}),
    "torus": Case(lambda: meshes.torus(9, 6), (0.3, 0.03), {0, 1, 2, 3}),
    "landscape": Case(lambda: meshes.landscape(5, 4), (0.5, 0.08, 0.02), {0, 1, 2, 3}, BOTH, everywhere=True),
    "cylinder": Case(lambda: meshes.cylinder(7), (0.3, 0.03), {0, 1, 2, 3}, everywhere=True),
    "icosphere": Case(lambda: meshes.bumpy(scene.icosphere(1), 0.1), (0.3, 0.03), {0, 1, 2, 3}),
    "valence 2": Case(meshes.valence_two, (0.5, 0.1), {0, 1, 2, 3}, BOTH),
    "valence 12": Case(lambda: meshes.fan(12, 2), (1.0, 0.2), {0, 1, 2}, BOTH),
    "creases": Case(
        lambda: softened(meshes.with_random_creases(meshes.landscape(5, 5), share=0.3)),
        (1.0, 0.3, 0.1),
        {0, 1, 2, 3},
        BOTH,
    ),
    "creased cylinder": Case(
        lambda: softened(meshes.with_random_creases(meshes.cylinder(5), share=0.4)), (1.0, 0.3, 0.1), {0, 1, 2, 3}
    ),
    "creased cube": Case(
        lambda: softened(meshes.corner_creased_cube()), (1.0, 0.3, 0.1), {0, 1, 2, 3}, everywhere=True
    ),
    "two cubes": Case(meshes.two_cubes_sharing_an_edge, (1.0, 0.3), {0, 1, 2, 3}, everywhere=True),
}


def cases() -> list[object]:
    """Every mesh with its boundaries; in the short suite sharp corners on one mesh."""
    return [
        pytest.param(
            name,
            boundary,
            marks=[pytest.mark.thorough] * (boundary != "ALL" and name != "landscape")
            + [pytest.mark.every_blender] * case.everywhere,
        )
        for name, case in CASES.items()
        for boundary in case.boundaries
    ]


@pytest.mark.parametrize(("name", "boundary"), cases())
@pytest.mark.parametrize("deeper", DEEPER)
def test_no_face_at_its_depth_is_farther_than_promised(name: str, boundary: str, deeper: int) -> None:
    case = CASES[name]
    data = meshes.single_precision(case.build())
    holder = scene.add_object(data)
    scene.add_subdivision(holder, 1, boundary)
    answers = []
    for tolerance, method, vertices in product(case.tolerances, EQUAL_METHODS, VERTICES):
        addon.compute(holder, tolerance=tolerance, method=method, vertices=vertices)
        assert addon.bounds(holder).max() <= np.float32(tolerance)
        answers.append((method, vertices, addon.depths(holder), addon.bounds(holder)))
    seen = set()
    for depth in range(5):
        faces = np.flatnonzero(np.any([depths == depth for _, _, depths, _ in answers], axis=0))
        faces = np.random.default_rng(depth).permutation(faces)
        while len(faces) and quad_count(part_of(data, faces)[0], depth + deeper) > MOST_QUADS[deeper]:
            faces = faces[: len(faces) // 2]
        if not len(faces):
            continue
        seen.add(depth)
        part, numbers = part_of(data, np.sort(faces))
        levels = BlenderLevels(part, boundary)
        distances = {vertices: levels.distances(depth, vertices, deeper) for vertices in VERTICES}
        levels.remove()
        for method, vertices, depths, bounds in answers:
            here = np.isin(numbers, faces) & (depths[numbers] == depth)
            # Single precision of the facets, and of the deep level.
            allowed = bounds[numbers] + 2 * rounding(data, depth + deeper)
            assert np.all((distances[vertices] <= allowed)[here]), (method, vertices, depth)
    assert seen >= case.depths
