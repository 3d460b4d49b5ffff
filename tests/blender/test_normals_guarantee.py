# SPDX-License-Identifier: GPL-3.0-or-later
"""The promise of the angles of adaptive subdivision: every point of the limit surface has near by a drawn point whose
normal is within the angle, and the other way round.

The surface is Blender's own Subdivision Surface modifier with Use Limit Surface, some levels deeper: its facets are
points with normals. Nothing of the add-on but the result is asked.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.arrays.vectors import units
from tests import meshes
from tests.blender import scene
from tests.blender.subdividing import shape, subdivide
from tests.thorough import each

# Blender's own Python has no SciPy.
cKDTree = pytest.importorskip("scipy.spatial").cKDTree

LEVEL = 6
MOST_FACES = 100_000

# A sample stands for the points around it, whose normals turn by as much as those of its nearest samples, of which
# there are so many; by more than this, in degrees, they turn at a crease.
NEAREST, CREASED = 9, 20.0

# Single precision turns the facets of the deep level by less, in degrees.
ROUNDING = 0.1

# Points are compared within twice the tolerance; samples lie this part of the tolerance apart.
SPACING = 0.4


def rings() -> meshes.MeshData:
    """Three coincident rings around a cylinder."""
    return meshes.cylinder(8, ((1, -1), (1, 0), (1, 0), (1, 0), (1, 1)))


def needles() -> meshes.MeshData:
    return meshes.bent(meshes.grid(40, 1), lambda x, y, z: (x, 0.002 * y, 0.3 * np.sin(x / 3)))


def cube_with_creases(crease: float) -> meshes.MeshData:
    cube = meshes.cube()
    differences = np.count_nonzero(cube.positions[:, None] != cube.positions, axis=2)
    return meshes.creased(cube, {(int(i), int(j)): crease for i, j in np.argwhere(differences == 1) if i < j})


MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "torus": lambda: meshes.torus(7, 5),
    "landscape": lambda: meshes.landscape(4, 3),
    "n-gons": lambda: meshes.bumpy(meshes.cylinder(7), 0.1),
    "triangles": lambda: meshes.sphere(5, 2),
    "concave faces": meshes.concave_faces,
    "valences 3 and 7": lambda: meshes.trapezohedron(7),
    "Möbius strip": meshes.mobius_strip,
    "random creases": lambda: meshes.with_random_creases(meshes.landscape(3, 2), share=0.4),
    "coincident rings": rings,
    "needles": needles,
}


def made(data: meshes.MeshData, tolerance: float, shading: float, facets: float = 0.0) -> AdaptiveMesh:
    """The result within a tolerance in parts of the diagonal, and angles in degrees."""
    mesh = meshes.build(data)
    request = AdaptiveRequest(
        tolerance * meshes.diagonal(mesh),
        Mode.ADAPTIVE,
        MOST_FACES,
        shading=float(np.radians(shading)),
        facets=float(np.radians(facets)),
    )
    return subdivide_adaptively(mesh, request, mesh.positions)


def triangles_of(found: AdaptiveMesh) -> tuple[NDArray, NDArray, NDArray]:
    """(M, 3, 3) twice: the drawn triangles with the normals stored at their corners; and (M,) the face of each."""
    fans = [
        [first, first + k, first + k + 1, face]
        for face, (first, last) in enumerate(pairwise(found.mesh.face_starts.tolist()))
        for k in range(1, last - first - 1)
    ]
    assert found.normals is not None
    fans, faces = np.array(fans)[:, :3], np.array(fans)[:, 3]
    corners = found.mesh.positions[found.mesh.corner_vertices[fans]]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    has_area = np.linalg.norm(areas, axis=1) > 1e-14
    return corners[has_area], found.normals[fans][has_area], faces[has_area]


def samples_of(corners: NDArray, normals: NDArray, spacing: float) -> tuple[NDArray, NDArray, NDArray]:
    """(N, 3) twice: points inside triangles, no farther apart than the spacing, and their interpolated normals; and
    (N,) the triangle of each."""
    steps = np.ceil(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1) / spacing).astype(int)
    found = [(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=int))]
    for count in np.unique(np.maximum(steps, 2)).tolist():
        own = np.flatnonzero(np.maximum(steps, 2) == count)
        places = np.array(list(thirds(count))) / count
        both = (np.einsum("sk,mkc->smc", places, each[own]).reshape(-1, 3) for each in (corners, normals))
        found.append((*both, np.tile(own, len(places))))
    points, directions, owners = (np.concatenate(column) for column in zip(*found, strict=True))
    return points, units(directions), owners


def thirds(count: int) -> Iterator[tuple[float, float, float]]:
    for i in range(count):
        for j in range(count - i):
            yield i + 1 / 3, j + 1 / 3, count - 1 - i - j + 1 / 3


def facets_of_level(data: meshes.MeshData, level: int) -> tuple[NDArray, NDArray, float]:
    """(N, 3) twice: the middles of the facets of the modifier's level, and their normals; and the longest side."""
    scene.clear()
    blender_object = scene.add_object(data)
    modifier = blender_object.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.quality, modifier.use_limit_surface = level, 10, True
    mesh = blender_object.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    positions = scene.values_of(mesh.vertices, "co", np.float32, 3).astype(np.float64)
    corners = positions[scene.triangles_of(mesh)]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(areas, axis=1)
    # Single precision leaves smaller facets, as between coincident rings, without a normal.
    has_area = sizes > 1e-3 * sizes.max()
    longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
    return corners[has_area].mean(axis=1), units(areas[has_area]), longest


def angles_apart(
    points: NDArray, normals: NDArray, others: NDArray, their_normals: NDArray, radius: float, enough: NDArray | float
) -> NDArray:
    """(N,) in degrees: the least angle of each point's normal to the normals of others within a radius, and of what
    these stand for; or to those of the nearest of them, where that is no more than enough (N,)."""
    tree = cKDTree(others)

    def least_angles(which: NDArray, near: NDArray, owners: NDArray) -> NDArray:
        """(W,) of points (W,), among others (K,) by the places of their points in ``which`` (K,), which rise."""
        used, places = np.unique(near, return_inverse=True)
        around = their_normals[tree.query(others[used], NEAREST)[1]]
        turns = degrees_between(around, their_normals[used, None])
        turn = np.where(turns < CREASED, turns, 0.0).max(axis=1)
        angles = degrees_between(their_normals[near], normals[which[owners]]) - turn[places]
        return np.minimum.reduceat(angles, np.flatnonzero(np.diff(owners, prepend=-1)))

    distances, nearest = tree.query(points, NEAREST, distance_upper_bound=radius)
    is_near = np.isfinite(distances)
    assert is_near.any(axis=1).all(), "some point has no other near"
    found = least_angles(np.arange(len(points)), nearest[is_near], np.nonzero(is_near)[0])
    left = np.flatnonzero(found > enough)
    if len(left):
        near = tree.query_ball_point(points[left], radius)
        owners = np.repeat(np.arange(len(left)), [len(own) for own in near])
        found[left] = least_angles(left, np.concatenate([np.array(own) for own in near]), owners)
    return found


def degrees_between(one: NDArray, other: NDArray) -> NDArray:
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=-1), -1.0, 1.0)))


@pytest.mark.parametrize(("tolerance", "shading", "facets"), [(5e-3, 8.0, 20.0)])
@pytest.mark.parametrize("name", each(MESHES, ["torus", "n-gons", "valences 3 and 7", "coincident rings"]))
def test_normals_are_within_the_angles_both_ways(name: str, tolerance: float, shading: float, facets: float) -> None:
    data = MESHES[name]()
    found = made(data, tolerance, shading, facets)
    assert found.narrow_count == 0, "narrow parts need not keep the angles"
    assert found.angles.max() <= np.radians(shading)
    assert_within(data, found, tolerance, shading, facets)


def assert_within(
    data: meshes.MeshData, found: AdaptiveMesh, tolerance: float, shading: float, facets: float = 0.0, count: int = 3000
) -> None:
    """Compare samples with the modifier: of the drawn mesh where faces have a proved angle, and of the surface where
    nothing is narrow. Faces beside semi-sharp edges may have narrow parts and a proved angle of the others."""
    corners, stored, faces = triangles_of(found)
    flat = np.repeat(units(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))[:, None], 3, axis=1)
    middles, surface, longest = facets_of_level(data, LEVEL)
    limit, generator = tolerance * meshes.diagonal(meshes.build(data)), np.random.default_rng(1)
    chosen = generator.permutation(len(middles))[:count]
    for normals, angle in ((stored, shading), (flat, facets)):
        if not angle:
            continue
        points, directions, owners = samples_of(corners, normals, SPACING * limit)
        assert cKDTree(points).query(middles[chosen])[0].max() <= (1 + SPACING) * limit
        if found.narrow_count and any(0 < crease < 1 for crease in data.edge_creases.values()):
            continue
        proved = np.degrees(found.angles[faces[owners]])
        some = generator.permutation(np.flatnonzero(proved > 0))[: 2 * count]
        most = ROUNDING + np.where(angle == shading, proved[some], angle)
        there = angles_apart(points[some], directions[some], middles, surface, 2 * limit + longest, most)
        assert (there <= most).all()
        if found.narrow_count == 0:
            reach, most = (2 + SPACING) * limit, angle + ROUNDING
            assert angles_apart(middles[chosen], surface[chosen], points, directions, reach, most).max() <= most


@pytest.mark.parametrize("name", each(["torus", "landscape", "n-gons", "Möbius strip"], ["torus", "landscape"]))
def test_reduce_gains_and_keeps_the_angle(name: str) -> None:
    data, shading = MESHES[name](), 8.0
    original = scene.add_object(data)
    original.data.shade_smooth()
    settings = {"tolerance": 5e-3, "tolerance_mode": "RELATIVE", "shading_angle": np.radians(shading)}
    (result,) = subdivide(original, reduce=True, **settings)
    record, triangles = result.data.ccdepth, scene.triangles_of(result.data)
    # Suzanne's at 1e-3 are nine in ten.
    assert len(triangles) < 0.95 * record.unreduced_triangles
    stored = scene.values_of(result.data.corner_normals, "vector", np.float32, 3).reshape(-1, 3, 3).astype(float)
    limit = record.world_tolerance
    points, directions, _ = samples_of(shape(result)[triangles].astype(float), stored, SPACING * limit)
    middles, surface, longest = facets_of_level(data, LEVEL)
    some = np.random.default_rng(1).permutation(len(points))[:6000]
    chosen = np.random.default_rng(2).permutation(len(middles))[:3000]
    most = shading + ROUNDING
    there = angles_apart(points[some], directions[some], middles, surface, 2 * limit + longest, most)
    back = angles_apart(middles[chosen], surface[chosen], points, directions, (2 + SPACING) * limit, most)
    assert max(there.max(), back.max()) <= most


@pytest.mark.parametrize("seed", each(range(400), (3, 25, 40, 61)))
def test_random_meshes_keep_the_angles(seed: int) -> None:
    generator, data = np.random.default_rng(seed), random_mesh(seed)
    tolerance, shading = generator.choice([3e-2, 1.5e-2, 8e-3]), generator.choice([3.0, 8.0, 20.0, 45.0])
    facets = generator.choice([0.0, 0.0, 15.0, 30.0])
    assert_within(data, made(data, tolerance, shading, facets), tolerance, shading, facets, count=800)


def random_mesh(seed: int) -> meshes.MeshData:
    """A mesh with creases and their ends, poles, borders and their corners, or n-gons, of an uneven scale."""
    generator = np.random.default_rng(seed)
    kinds = [
        lambda: meshes.landscape(*generator.integers(1, 5, 2).tolist(), seed=seed),
        lambda: meshes.bumpy(meshes.torus(6, 5), 0.1, seed=seed),
        lambda: meshes.bumpy(meshes.cylinder(int(generator.integers(3, 9))), 0.15, seed=seed),
        lambda: meshes.fan(int(generator.integers(3, 10)), seed=seed),
        lambda: meshes.with_random_creases(meshes.landscape(3, 2, seed=seed), seed=seed),
        lambda: meshes.bumpy(meshes.trapezohedron(int(generator.integers(3, 9))), 0.15, seed=seed),
    ]
    data = kinds[seed % len(kinds)]()
    edges = sorted({(min(ends), max(ends)) for face in data.faces for ends in pairwise([*face, face[0]])})
    sharp = generator.choice(len(edges), generator.integers(0, 4), replace=False).tolist()
    vertices = generator.choice(len(data.positions), generator.integers(0, 2), replace=False).tolist()
    data = meshes.creased(data, {**data.edge_creases, **{edges[k]: 1.0 for k in sharp}}, dict.fromkeys(vertices, 1.0))
    scale, shear = generator.uniform(0.2, 1.0, 3), generator.uniform(-0.5, 0.5)
    return meshes.bent(data, lambda x, y, z: (scale[0] * (x + shear * y), scale[1] * y, scale[2] * z))


def test_a_nearly_sharp_cube_keeps_its_faces() -> None:
    by_distance = made(cube_with_creases(0.9), 1e-3, 0.0)
    found = made(cube_with_creases(0.9), 1e-3, 5.0)
    assert len(found.bounds) <= 2 * len(by_distance.bounds)
    # All faces have edges that are rounded within the reach, and are drawn flat.
    assert found.narrow_count == len(found.bounds)
    corners, normals, _ = triangles_of(found)
    flat = units(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    # Stored from inside, where the surface is flat up to the rounding of its evaluation.
    assert np.abs(normals - flat[:, None]).max() < 1e-4


def test_without_an_angle_nothing_changes() -> None:
    found = made(MESHES["torus"](), 5e-3, 0.0)
    assert found.normals is None
    assert not found.angles.any()
    assert found.narrow_count == 0


def test_stored_normals_are_those_of_the_object_of_an_uneven_scale() -> None:
    data = MESHES["landscape"]()
    mesh = meshes.build(data)
    axes = np.array([[2.0, 0.3, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, -1.0]])
    in_scene = mesh.changed(positions=mesh.positions @ axes.T)
    request = AdaptiveRequest(0.02, Mode.ADAPTIVE, MOST_FACES, axes, shading=0.1)
    found = subdivide_adaptively(in_scene, request, mesh.positions)
    corners, normals, _ = triangles_of(found)
    own = units(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    # Seen in the object's own space, whose faces are not mirrored there, normals are on the side of the faces.
    assert (np.einsum("mkc,mc->mk", normals, own) > 0.5).all()
    assert np.abs(np.linalg.norm(normals, axis=2) - 1).max() < 1e-12


def test_angles_of_shading_count_on_smooth_faces_alone() -> None:
    data = MESHES["torus"]()
    mesh = meshes.build(data)
    is_smooth = np.arange(mesh.face_count) % 2 == 0
    request = AdaptiveRequest(0.05, Mode.ADAPTIVE, MOST_FACES, shading=0.1, is_smooth=is_smooth)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    np.testing.assert_array_equal(found.angles > 0, is_smooth[found.mesh.base_faces])
