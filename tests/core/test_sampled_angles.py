# SPDX-License-Identifier: GPL-3.0-or-later
"""Largest angles at samples, against closed forms."""

import numpy as np
import pytest

from ccdepth_addon.core import PolygonMesh, SampledSurface
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from tests import meshes
from tests.core.test_deviation import result

# Far below what is drawn: points within it do not make up for angles.
TOLERANCE = 1e-5


def tick() -> None:
    """Report nothing."""


def sampled(control: PolygonMesh, tolerance: float = TOLERANCE) -> SampledSurface:
    return SampledSurface(control, tolerance, tick)


def largest(surface: SampledSurface, drawn: tuple[FloatArray, IndexArray], normals: FloatArray | None = None) -> float:
    """The largest angle in degrees."""
    return float(np.degrees(surface.largest_of_all(*drawn, [normals], tick)[0]))


def facet_normals(positions: FloatArray, corners: IndexArray) -> FloatArray:
    """(T, 3, 3): the normals of triangles, at each of their corners."""
    a, b, c = np.moveaxis(positions[corners], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.repeat(normals[:, None], 3, axis=1)


def creased_cube(crease: float) -> PolygonMesh:
    data = meshes.cube()
    data.edge_creases.update({(int(a), int(b)): crease for a, b in data.edges})
    return meshes.build(data)


def test_facets_of_a_parabola() -> None:
    """A grid bent to z = x²/10 has the limit surface z = x²/10 + 1/30 away from its border (uniform cubic splines); a
    chord from 0 to h has the slope h/10, and the surface 0 at its beginning and h/5 at its end."""
    data = meshes.bent(meshes.grid(8, 8), lambda x, y, z: (x - 4, y - 4, (x - 4) ** 2 / 10))
    positions = np.array([[x, y, x**2 / 10 + 1 / 30] for x in (0.0, 0.5) for y in (-0.5, 0.5)])
    drawn = positions, np.array([[0, 2, 3], [0, 3, 1]])
    # Of these the larger; the surface beside the two triangles is no nearer than its border, and so is left out.
    own = np.degrees(np.arctan(0.05))
    surface = sampled(meshes.build(data))
    beginning = surface.normals_of(*drawn, np.radians(10), tick)
    np.testing.assert_allclose(beginning[0, 0], [0, 0, 1], atol=1e-9)
    end = np.array([-0.1, 0.0, 1.0]) / np.hypot(0.1, 1.0)
    np.testing.assert_allclose(beginning[0, 1], end, atol=1e-9)
    facets = facet_normals(*drawn)[:, 0]
    assert np.degrees(np.arccos(facets @ [0, 0, 1])) == pytest.approx(own)
    assert np.degrees(
        surface.largest_angles(*drawn, None, np.radians(1.0), tick, np.ones(2, dtype=bool))
    ).min() >= own * (1 - 1e-3)


@pytest.mark.parametrize("tilt", [1.0, 10.0, 40.0])
def test_shading_that_is_tilted(tilt: float) -> None:
    control = meshes.build(meshes.grid(2, 2))
    drawn = result(control, 2, limit=True)
    normal = [np.sin(np.radians(tilt)), 0.0, np.cos(np.radians(tilt))]
    normals = np.broadcast_to(normal, (len(drawn[1]), 3, 3))
    # The rounding of a sum of squares.
    assert largest(sampled(control), drawn, normals) == pytest.approx(tilt, abs=1e-6)
    assert largest(sampled(control), drawn) == 0


def test_a_level_more_halves_the_angles_of_facets_and_quarters_those_of_shading() -> None:
    control = meshes.build(meshes.cube())
    surface = sampled(control)
    facets, shading = [], []
    for level in (2, 3, 4):
        drawn = result(control, level, limit=True)
        facets.append(largest(surface, drawn))
        shading.append(largest(surface, drawn, surface.normals_of(*drawn, np.radians(10), tick)))
    # Near extraordinary vertices orders are a little less.
    assert facets[0] / facets[1] == pytest.approx(2, abs=0.2)
    assert facets[1] / facets[2] == pytest.approx(2, abs=0.2)
    assert 2.5 < shading[0] / shading[1] < 4.5
    assert 2.5 < shading[1] / shading[2] < 4.5


def test_sides_of_a_sharp_crease_have_normals_of_their_own() -> None:
    control = creased_cube(1.0)
    drawn = result(control, 0, limit=False)
    surface = sampled(control)
    normals = surface.normals_of(*drawn, np.radians(10), tick)
    np.testing.assert_allclose(normals, facet_normals(*drawn), atol=1e-12)
    assert largest(surface, drawn) < 0.01
    assert largest(surface, drawn, normals) < 0.01
    # Shaded smooth across creases, a corner of three faces has their mean.
    rounded = (drawn[0] / np.linalg.norm(drawn[0], axis=1, keepdims=True))[drawn[1]]
    assert 30 < largest(surface, drawn, rounded) <= np.degrees(np.arccos(1 / np.sqrt(3))) + 1e-6


def test_parts_narrower_than_the_tolerance_do_not_count() -> None:
    """A cube with nearly sharp edges, within the tolerance of the cube itself, has round edges narrower than that."""
    control = creased_cube(0.95)
    drawn = result(control, 0, limit=False)
    assert largest(sampled(control, 0.05), drawn) < 1
    assert largest(sampled(control, 1e-4), drawn) > 20


def test_the_other_side_of_a_thin_sheet_does_not_count() -> None:
    data = meshes.cube()
    control = meshes.build(meshes.bent(data, lambda x, y, z: (x, y, z / 1000)))
    drawn = result(control, 4, limit=True)
    thin = sampled(control, 0.01)
    assert largest(thin, drawn) < 10
