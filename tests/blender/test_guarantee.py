# SPDX-License-Identifier: GPL-3.0-or-later
"""The promise itself: no face at its depth is farther from the limit surface than the tolerance, nor than proved.

Measured with Blender's own Subdivision Surface modifier, Use Limit Surface off, and nothing of the add-on's: a point
of a facet finds its counterpart, the one of the same face at the same parameters, in a much deeper level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import tightness
from tests import meshes
from tests.blender import addon, scene
from tests.blender.measuring import Positions, add_part, level_of, part_of, rounding
from tests.blender.named_meshes import NAMED
from tests.brute_force import Comparison

FloatArray = NDArray[np.float64]

# The surface is refined so many levels below the facets, and up to two more where these are cheap; in the short suite
# one level less.
LEVELS_DEEPER = 5
DEEPER = [LEVELS_DEEPER - 1, pytest.param(LEVELS_DEEPER, marks=pytest.mark.thorough)]

# Most quads of a deep level, which is what the time goes into. As many faces of a depth are measured as this allows.
# All numbers of quads are a quarter of these where the surface is refined a level less.
MOST_QUADS = 700_000
CHEAP_QUADS = 200_000


def bilinear(corners: FloatArray, steps: int) -> FloatArray:
    """(Q, 4, D) → (Q, steps + 1, steps + 1, D): the facets at equal steps."""
    along = np.linspace(0, 1, steps + 1)
    u, v = np.meshgrid(along, along, indexing="ij")
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    return np.einsum("cuv,qcd->quvd", weights, corners)


@dataclass(frozen=True)
class Distances:
    """Of some faces at one depth, (faces,) each: the largest distances found, and how uncertain these are."""

    control: FloatArray
    limit: FloatArray
    uncertainty: FloatArray


def measured(
    part: bpy.types.Object, faces: NDArray[np.intp], depth: int, deepest: int, deeper: int = LEVELS_DEEPER
) -> Distances:
    """The distances of the faces' facets at that depth from the surface at the same parameters.

    The deepest level stands in for the surface. A step moves a point by less than 0.655 of what the step before did,
    once its features have settled (no rule has a larger second eigenvalue), so that what is left of the way after the
    last step is less than twice that step. Limit vertices are those of that level too, and are as far off.
    """
    deep = Positions(level_of(part, deepest, faces), deepest)
    before = level_of(part, deepest - 1, faces)
    last_step = np.linalg.norm(deep.at(before.faces, before.parameters) - before.points, axis=1)

    facets = level_of(part, depth, faces)
    # The quads of a fan are a level down already.
    steps = 2 ** (deeper if facets.all_quads else deeper - 1)
    parameters = bilinear(facets.quads(facets.parameters), steps)
    surface = deep.at(facets.quad_faces[:, None, None], parameters)
    limits = deep.at(facets.faces, facets.parameters)
    control, limit = (
        np.linalg.norm(bilinear(facets.quads(corners), steps) - surface, axis=-1).max(axis=(1, 2))
        for corners in (facets.points, limits)
    )
    return Distances(
        largest_of_faces(control, facets.quad_faces, faces),
        largest_of_faces(limit, facets.quad_faces, faces),
        2 * largest_of_faces(last_step, before.faces, faces),
    )


def largest_of_faces(values: FloatArray, bases: NDArray[np.int64], faces: NDArray[np.intp]) -> FloatArray:
    """(faces,) the largest value of each one; the faces in rising order."""
    largest = np.zeros(len(faces))
    np.maximum.at(largest, np.searchsorted(faces, bases), values)
    return largest


# The settings of the add-on, and the faces to measure


@dataclass(frozen=True)
class Answer:
    """The add-on's depths and proved distances of all faces, and its settings."""

    tolerance: float
    method: str
    vertices: str
    depths: NDArray[np.int32]
    bounds: FloatArray


def answers(holder: bpy.types.Object, tolerances: tuple[float, ...]) -> Iterator[Answer]:
    core = addon.module("core.depth.face_depths")
    # By distance the farthest of a level is less than at equal parameters: benchmarks/least_levels.py.
    methods = [method for method in core.METHODS if method != "DISTANCE"]
    for tolerance, method, vertices in product(tolerances, methods, core.VERTICES):
        addon.compute(holder, tolerance=tolerance, method=method, vertices=vertices)
        bounds = addon.bounds(holder).astype(np.float64)
        yield Answer(tolerance, method, vertices, addon.depths(holder), bounds)


def quad_count(data: meshes.MeshData, level: int) -> int:
    """How many quads a mesh has at a level from 1 on."""
    return int(data.face_sizes.sum()) * 4 ** (level - 1)


def faces_to_measure(
    data: meshes.MeshData, wanted: NDArray[np.intp], depth: int, quads: int, deeper: int = LEVELS_DEEPER
) -> NDArray[np.intp]:
    """As many of the wanted faces, in random order, as fit in so many quads of the deep level with their neighbours."""
    order = np.random.default_rng(depth).permutation(wanted)
    count, least, most = 0, 1, len(order)
    while least <= most:
        middle = (least + most) // 2
        if quad_count(part_of(data, order[:middle])[0], depth + deeper) <= quads:
            count, least = middle, middle + 1
        else:
            most = middle - 1
    return np.sort(order[:count])


# The meshes


def softened(data: meshes.MeshData) -> meshes.MeshData:
    """So that the last semi-sharp rule has run out by level 3.

    The vertices of the deep level have then been under way to their limits for some levels already.
    """
    return meshes.softened(data, 0.5)


@dataclass(frozen=True)
class Case:
    """A mesh, the tolerances to ask for, and the depths of which some faces at least have to be measured.

    everywhere: whether it is measured in every Blender; the others, which are there for the bounds, in one.
    """

    build: Callable[[], meshes.MeshData]
    tolerances: tuple[float, ...]
    depths: set[int]
    quads: int = MOST_QUADS
    boundaries: tuple[str, ...] = ("ALL",)
    everywhere: bool = False


BOTH = ("ALL", "PRESERVE_CORNERS")

CASES: dict[str, Case] = {
    "cube": Case(meshes.cube, (1.0, 0.2, 0.03, 0.008), {0, 1, 2, 3, 4}, quads=1_600_000),
    "suzanne": Case(scene.suzanne, (0.5, 0.05, 0.01), {0, 1, 2, 3}, quads=1_000_000),
    "torus": Case(lambda: meshes.torus(9, 6), (0.3, 0.03), {0, 1, 2, 3}),
    "landscape": Case(
        lambda: meshes.landscape(5, 4), (0.5, 0.08, 0.02), {0, 1, 2, 3}, boundaries=BOTH, everywhere=True
    ),
    "cylinder": Case(lambda: meshes.cylinder(7), (0.3, 0.03), {0, 1, 2, 3}, everywhere=True),
    "icosphere": Case(lambda: meshes.bumpy(scene.icosphere(1), 0.1), (0.3, 0.03), {0, 1, 2, 3}),
    "valence 2": Case(meshes.valence_two, (0.5, 0.1), {0, 1, 2, 3}, boundaries=BOTH),
    "valence 12": Case(lambda: meshes.fan(12, 2), (1.0, 0.2), {0, 1, 2}, boundaries=BOTH),
    "creases": Case(
        lambda: softened(meshes.with_random_creases(meshes.landscape(5, 5), share=0.3)),
        (1.0, 0.3, 0.1),
        {0, 1, 2, 3},
        boundaries=BOTH,
    ),
    "creased cylinder": Case(
        lambda: softened(meshes.with_random_creases(meshes.cylinder(5), share=0.4)), (1.0, 0.3, 0.1), {0, 1, 2, 3}
    ),
    "creased cube": Case(
        lambda: softened(meshes.corner_creased_cube()), (1.0, 0.3, 0.1), {0, 1, 2, 3}, everywhere=True
    ),
    "two cubes": Case(meshes.two_cubes_sharing_an_edge, (1.0, 0.3), {0, 1, 2, 3}, everywhere=True),
}


@pytest.mark.parametrize(
    ("name", "boundary"),
    [
        pytest.param(
            name,
            boundary,
            # Sharp corners on one mesh will do.
            marks=[pytest.mark.thorough] * (boundary != "ALL" and name != "landscape")
            + [pytest.mark.every_blender] * case.everywhere,
        )
        for name, case in CASES.items()
        for boundary in case.boundaries
    ],
)
@pytest.mark.parametrize("deeper", DEEPER)
def test_no_face_at_its_depth_is_farther_than_promised(name: str, boundary: str, deeper: int) -> None:
    case = CASES[name]
    data = case.build()
    holder = scene.add_object(data)
    scene.add_subdivision(holder, 1, boundary)
    given = list(answers(holder, case.tolerances))
    seen, fewer = set(), 4 ** (LEVELS_DEEPER - deeper)
    for depth in range(5):
        wanted = np.flatnonzero(np.any([answer.depths == depth for answer in given], axis=0))
        faces = faces_to_measure(data, wanted, depth, case.quads // fewer, deeper)
        if not len(faces):
            continue
        seen.add(depth)
        part_data, numbers = part_of(data, faces)
        deepest = depth + deeper
        deepest += sum(quad_count(part_data, deepest + more) <= CHEAP_QUADS // fewer for more in (1, 2))
        part = add_part(part_data, numbers)
        scene.add_subdivision(part, 1, boundary).uv_smooth = "NONE"
        distances = measured(part, faces, depth, deepest, deeper)
        bpy.data.meshes.remove(part.data)
        for answer in given:
            assert_within(answer, distances, faces, depth, rounding(data, deepest))
    assert seen >= case.depths


def assert_within(answer: Answer, found: Distances, faces: NDArray[np.intp], depth: int, slack: float) -> None:
    """All of the measured faces that have this depth in the answer are as near as it says.

    A distance is uncertain by what is left of the way from the deep level to the surface, with limit vertices twice
    (of the corners' ways and the surface point's own), and by single precision.
    """
    here = answer.depths[faces] == depth
    control = answer.vertices == "CONTROL"
    distances = (found.control if control else found.limit)[here]
    slacks = (1 if control else 2) * found.uncertainty[here] + slack
    bounds = answer.bounds[faces][here]
    assert np.all(bounds <= np.float32(answer.tolerance))
    assert np.all(distances <= bounds + slacks), (answer.method, answer.vertices, answer.tolerance, depth)


# The other way round: certified depths are the least ones

TIGHT = ("cube", "torus", "Suzanne", "landscape with random creases", "valence 2", "valence 5", "valence 12", "n-gons")


@pytest.mark.parametrize("boundary", [pytest.param("ALL", marks=pytest.mark.thorough), "PRESERVE_CORNERS"])
def test_depths_are_the_least_ones(boundary: str) -> None:
    """A small part of benchmarks/tightness.py."""
    total = Comparison()
    for name in TIGHT:
        found, apart, _ = tightness.compare_mesh(NAMED[name](), boundary, 100_000, (3e-2, 1e-2, 3e-3, 1e-3))
        # The core's own surface is Blender's, but for rounding.
        assert apart < 1, name
        for compared in found.values():
            assert compared.below == 0, name
            assert compared.wrongly_exact == 0, name
            total += compared
    assert total.faces > 1000
    assert total.equal_share >= tightness.LEAST_EQUAL_SHARE
