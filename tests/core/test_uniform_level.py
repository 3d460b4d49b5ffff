# SPDX-License-Identifier: GPL-3.0-or-later
"""All faces at one level, and the first level at which all of them are within the tolerance."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ccdepth_addon.core.bounds.norm_bounds import PATCH_METHODS, Method, Vertices
from ccdepth_addon.core.depth.face_depths import METHODS, ToleranceError, face_depths, level_bounds, uniform_level
from ccdepth_addon.core.depth.modifier_quality import MOST_QUALITY, needed_quality, unmet_corners
from ccdepth_addon.core.depth.norm_depth import bounds_fall
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches
from tests import meshes
from tests.brute_force import Levels
from tests.core.test_face_depths import LEVELS, both_vertices, build, every_method, sampled
from tests.level_nets import worse_later

# Sampled distances are true ones up to rounding in double precision, at coordinates of some ten.
ROUNDING = 1e-12

NAMES = ["triangles and quads", "valences 2 and 12", "landscape with random creases", "soup"]


@pytest.mark.parametrize("name", NAMES)
@every_method
@both_vertices
def test_faces_are_near_enough_where_that_is_proved(name: str, method: str, vertices: str) -> None:
    """At any level, at the uniform level, and lasting ones at every later level."""
    mesh, distances = sampled(name, vertices)
    proved = 0
    for tolerance in (2.0, 0.5, 0.1):
        found = face_depths(mesh, tolerance, method, vertices)
        for level in range(LEVELS):
            bounds = level_bounds(mesh, tolerance, method, vertices, level)
            assert np.all(distances[level] <= bounds + ROUNDING)
            assert np.all((bounds <= tolerance) | np.isinf(bounds))
            assert np.all(np.isfinite(bounds[found.depths == level]))
            proved += np.count_nonzero(np.isfinite(bounds) & (found.depths != level))
            due = found.lasting & (found.depths <= level)
            assert np.all(distances[level][due] <= tolerance)
            assert np.all(np.isfinite(bounds[due]))
        level = uniform_level(mesh, tolerance, method, vertices)
        assert level >= found.depths.max()
        assert level >= LEVELS or np.all(distances[level] <= tolerance)
    # The methods by norms are too coarse for some of these meshes to prove more at these levels.
    assert proved or method != "CERTIFIED"


@pytest.mark.parametrize("name", NAMES)
@every_method
@pytest.mark.parametrize("tolerance", [2.0, 0.5, 0.1, 0.02])
def test_the_uniform_level_is_the_first_with_bounds_of_all_faces(name: str, method: str, tolerance: float) -> None:
    """Whatever is not evaluated again would have been found to hold."""
    mesh = build(meshes.AWKWARD[name](), smooth_corners=False)
    found = uniform_level(mesh, tolerance, method, "CONTROL")
    depths = face_depths(mesh, tolerance, method, "CONTROL").depths
    for level in range(int(depths.max()), found + 1):
        assert np.isfinite(level_bounds(mesh, tolerance, method, "CONTROL", level)).all() == (level == found)


@every_method
def test_most_regular_faces_are_lasting(method: str) -> None:
    found = face_depths(build(meshes.landscape(12, 12)), 1e-3, method, "CONTROL")
    assert np.count_nonzero(found.lasting) > 0.8 * len(found.lasting)


@both_vertices
def test_many_faces_at_semi_sharp_creases_are_lasting(vertices: str) -> None:
    mesh = build(meshes.with_random_creases(meshes.landscape(12, 12), seed=2, share=0.1))
    flat = mesh.changed(positions=mesh.positions * [1.0, 1.0, 0.01])
    found = face_depths(flat, 0.1, "CERTIFIED", vertices)
    at_creases = (classify_patches(flat).kinds == PatchKind.IRREGULAR) & (found.depths == 0)
    # Where creases turn, on about half of these faces, bounds that last are no smaller than an edge.
    assert np.count_nonzero(found.lasting[at_creases]) > 0.4 * np.count_nonzero(at_creases) > 0


EPSILON = 1.1


@cache
def torus_counter_example() -> PolygonMesh:
    return build(worse_later(meshes.torus(5, 5), 12, "LIMIT", EPSILON, 1, others_near=True))


@cache
def grid_counter_example() -> PolygonMesh:
    """3 × 3 faces. The middle one is near enough at levels 0 and 3, and not between."""
    flat = meshes.grid(3, 3)
    mesh = build(worse_later(flat, 4, "CONTROL", EPSILON, 1, others_near=False), smooth_corners=False)
    # The program knew level 0 at some places only; distances go with the heights, the grid itself being even and flat.
    share = 1.07 / Levels(mesh).distances(0, "CONTROL", 5)[4]
    return mesh.changed(positions=flat.positions + share * (mesh.positions - flat.positions))


def test_the_deepest_depth_is_not_enough_for_all_faces() -> None:
    """On a torus a face of depth 0 is off at level 1, which is the deepest depth: level 2 it has to be."""
    mesh = torus_counter_example()
    levels = Levels(mesh)
    distances = [levels.distances(level, "LIMIT", 4) for level in range(3)]
    assert distances[0][12] <= EPSILON < 1.1 * EPSILON < distances[1][12]
    assert np.delete(distances[1], 12).max() <= EPSILON
    depths = face_depths(mesh, EPSILON, "CERTIFIED", "LIMIT").depths
    assert (depths[12], depths.max()) == (0, 1)
    assert np.isinf(level_bounds(mesh, EPSILON, "CERTIFIED", "LIMIT", 1)[12])
    assert uniform_level(mesh, EPSILON, "CERTIFIED", "LIMIT") == 2
    assert distances[2].max() <= EPSILON


def test_a_face_may_be_farther_at_the_next_two_levels() -> None:
    """The middle face of 3 × 3, whose depth is 0, is off at level 1 by several times the tolerance, and at level 2."""
    mesh = grid_counter_example()
    levels = Levels(mesh)
    distances = [levels.distances(level, "CONTROL", 4)[4] for level in range(4)]
    assert distances[0] <= EPSILON
    assert distances[1] > 4 * EPSILON
    assert distances[2] > EPSILON >= distances[3]
    assert face_depths(mesh, EPSILON, "CERTIFIED", "CONTROL").depths[4] == 0
    bounds = [level_bounds(mesh, EPSILON, "CERTIFIED", "CONTROL", level)[4] for level in range(4)]
    assert np.isfinite(bounds).tolist() == [True, False, False, True]


@pytest.mark.parametrize("method", ["SHARP", "SECOND_ORDER", "FIRST_ORDER"])
@both_vertices
def test_bounds_that_are_said_to_fall_do(method: str, vertices: str) -> None:
    generator, rules = np.random.default_rng(5), PATCH_METHODS[Method(method)]
    bounds = [rules.regular(generator.normal(size=(4, 4, 8, 3)), Vertices(vertices))]
    if method != "SHARP":
        nets = (generator.normal(size=(2 * n + 8, 8, 3)) for n in [3, *range(5, 130), 400, 401, 1000, 5000])
        bounds += [rules.extraordinary(net, Vertices(vertices)) for net in nets]
    for each in bounds:
        assert np.all(np.diff([each.at(level) for level in range(60)], axis=0) <= 0)


def test_which_bounds_fall() -> None:
    patches = classify_patches(build(meshes.AWKWARD["valences 2 and 12"](), smooth_corners=False))
    kinds = patches.kinds
    assert set(kinds.tolist()) == {PatchKind.REGULAR, PatchKind.EXTRAORDINARY, PatchKind.IRREGULAR}
    for method, rules in PATCH_METHODS.items():
        expected = [PatchKind.REGULAR] if method is Method.SHARP else [PatchKind.REGULAR, PatchKind.EXTRAORDINARY]
        np.testing.assert_array_equal(bounds_fall(patches, rules), np.isin(kinds, expected))


@every_method
@both_vertices
def test_progress_rises_over_several_levels(method: str, vertices: str) -> None:
    for mesh in (torus_counter_example(), build(meshes.AWKWARD["soup"](), smooth_corners=False)):
        depths = face_depths(mesh, EPSILON, method, vertices).depths
        fractions: list[float] = []
        uniform_level(mesh, EPSILON, method, vertices, depths, progress=fractions.append)
        assert fractions == sorted(fractions)
        assert fractions[0] >= 0
        assert fractions[-1] < 1
        least = int(depths.max()) + 2
        assert uniform_level(mesh, EPSILON, method, vertices, depths, least) == least


def test_limit_vertices_take_a_level_at_least() -> None:
    """A modifier at level 0 moves nothing to the limit surface."""
    mesh = build(meshes.grid(3, 3), smooth_corners=False)
    assert [uniform_level(mesh, 0.1, "CERTIFIED", vertices) for vertices in ("CONTROL", "LIMIT")] == [0, 1]


def test_bad_tolerances_are_refused() -> None:
    with pytest.raises(ToleranceError):
        level_bounds(build(meshes.cube()), 1e-12, METHODS[0], "CONTROL", 1)


# What Use Limit Surface needs


@pytest.mark.parametrize(("crease", "sharpness"), [(0.3, 1), (0.7, 5), (0.9, 9), (0.99, 10)])
def test_quality_reaches_the_level_and_the_end_of_the_sharpness(crease: float, sharpness: int) -> None:
    mesh = build(meshes.creased(meshes.cube(), {(1, 3): crease, (3, 7): crease, (5, 7): crease, (1, 5): crease}))
    assert [needed_quality(mesh, level, 0.01) for level in (1, 5, 11)] == [sharpness, max(5, sharpness), 11]


def test_corners_of_an_open_mesh_need_more() -> None:
    """A smooth corner of one face is off by a sixth of its second difference, and a quarter of that with each level."""
    smooth, kept = (build(meshes.grid(3, 3), smooth_corners=smooth) for smooth in (True, False))
    unmet = unmet_corners(smooth)
    assert set(smooth.corner_vertices[unmet.corners].tolist()) == {0, 3, 12, 15}
    # 2V - V₋₁ - V₁ is (1, 1) at the corner.
    np.testing.assert_allclose(unmet.gaps, np.sqrt(2) / 6 * 0.25 ** np.arange(MOST_QUALITY + 1), rtol=1e-9)
    assert needed_quality(smooth, 1, 0.01) == 6
    assert needed_quality(kept, 1, 0.01) == 1
    assert needed_quality(smooth, 1, 1e-7) > MOST_QUALITY
