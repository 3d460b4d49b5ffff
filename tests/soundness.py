# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a subdivided mesh is the control mesh cut into pieces, without cracks, overlaps or doubled parts.

Only what a result says of itself is used, nothing of how it was made. Parameters are dyadic fractions, so that what is
said of them on quads is exact.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ccdepth_addon.core.adaptive.subdivided_mesh import SubdividedMesh
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests.brute_force import SQUARE

# Vertices that are nearer to each other, as a part of the diagonal, are one vertex made twice: rounding keeps the same
# point of the surface together to 1e-15, and the least faces of the tests are some 1e-6 wide.
SAME_POINT = 1e-10

# Areas of regular polygons are sums of a few rounded products.
AREA_ROUNDING = 1e-12

# A face covers at least this part of the square over its longest side. The templates' triangles cover a quarter or more
# of a square; what makes them longer is the surface, most at sharp vertices, where it ends in needles.
LEAST_AREA = 1e-4

# The deepest level places are told apart on.
DEEPEST = 22


def assert_sound(base: PolygonMesh, made: SubdividedMesh) -> None:
    assert_consistent(base, made)
    assert_sides_tile_edges(base, made)
    assert_same_topology(base, made)
    assert_covers_each_face_once(base, made)
    assert_no_vertex_inside_sides(base, made)


def sizes(made: SubdividedMesh) -> IndexArray:
    return np.diff(made.face_starts)


def drawn(mesh: SubdividedMesh) -> IndexArray:
    """(T, 3) the vertices of the triangles that faces are drawn as, in fans."""
    starts, counts = mesh.face_starts[:-1], sizes(mesh)
    corners = [starts[counts > place + 1, None] + [0, place, place + 1] for place in range(1, counts.max() - 1)]
    return mesh.corner_vertices[np.concatenate(corners)].astype(np.intp)


def following(made: SubdividedMesh) -> IndexArray:
    """(C,) the corner after each."""
    after = np.arange(1, len(made.corner_vertices) + 1)
    after[made.face_starts[1:] - 1] = made.face_starts[:-1]
    return after


def corner_faces(made: SubdividedMesh) -> IndexArray:
    return np.repeat(np.arange(len(made.base_faces)), sizes(made))


def assert_consistent(base: PolygonMesh, made: SubdividedMesh) -> None:
    """The arrays fit together: vertices and edges are those of the faces, each once, and the base mesh's loose ones;
    points lie in the base face that their face is said to be of."""
    assert np.all(sizes(made) >= 3)
    assert np.array_equal(np.unique(made.corner_vertices), np.flatnonzero(made.vertex_points.corners >= 0))
    assert np.count_nonzero(made.vertex_points.corners < 0) == np.count_nonzero(base.vertex_face_counts == 0)
    ends = np.stack([made.corner_vertices, made.corner_vertices[following(made)]], axis=1)
    assert np.all(ends[:, 0] != ends[:, 1])
    assert np.array_equal(np.sort(made.edge_vertices[made.corner_edges], axis=1), np.sort(ends, axis=1))
    keys = np.sort(made.edge_vertices, axis=1) @ [len(made.positions), 1]
    assert len(np.unique(keys)) == len(keys)
    loose = np.setdiff1d(np.arange(len(made.edge_vertices)), made.corner_edges)
    assert np.array_equal(np.sort(made.base_edges[loose]), np.flatnonzero(base.edge_face_counts == 0))
    of_corners = made.base_faces[corner_faces(made)]
    assert np.array_equal(base.corner_faces[made.corner_points.corners], of_corners)
    assert np.array_equal(np.unique(made.base_faces), np.arange(base.face_count))
    for points in (made.corner_points, made.vertex_points):
        assert np.all((points.parameters >= 0) & (points.parameters <= 1))


def along_half_edges(base: PolygonMesh, points: SurfacePoints) -> tuple[IndexArray, FloatArray]:
    """(N, 2) the half-edges of its own face that each point lies on, or -1, and (N, 2) where between its ends."""
    u, v = points.parameters.T
    own = np.where(v == 0, points.corners, -1)
    before = np.where(u == 0, base.previous_corner[points.corners], -1)
    return np.stack([own, before], axis=1), np.stack([u / 2, 1 - v / 2], axis=1)


def sides_on_half_edges(base: PolygonMesh, made: SubdividedMesh) -> tuple[IndexArray, FloatArray]:
    """(C,) the half-edge of the base mesh the side after each corner lies on, or -1; (C, 2) from where to where."""
    on, where = along_half_edges(base, made.corner_points)
    after = following(made)
    half_edges = np.full(len(on), -1)
    span = np.zeros((len(on), 2))
    for first in (0, 1):
        for second in (0, 1):
            same = (on[:, first] >= 0) & (on[:, first] == on[after, second])
            half_edges[same] = on[same, first]
            span[same] = np.stack([where[:, first], where[after, second]], axis=1)[same]
    return half_edges, span


def assert_sides_tile_edges(base: PolygonMesh, made: SubdividedMesh) -> None:
    """Sides run along each half-edge of the base mesh from end to end, in its direction, from the same points as on its
    other faces; every edge has as many faces as the base edge it lies on, and two where it lies on none."""
    half_edges, span = sides_on_half_edges(base, made)
    outer = half_edges >= 0
    assert np.all(span[outer, 0] < span[outer, 1])
    lengths = np.bincount(half_edges[outer], weights=(span[:, 1] - span[:, 0])[outer], minlength=base.corner_count)
    assert np.all(lengths == 1)

    base_edges = np.where(outer, base.corner_edges[half_edges], -1)
    assert np.array_equal(made.base_edges[made.corner_edges], base_edges)
    counts = np.bincount(made.corner_edges, minlength=len(made.edge_vertices))
    expected = np.where(made.base_edges < 0, 2, base.edge_face_counts[made.base_edges])
    assert np.array_equal(counts, expected)

    # The two sides of an edge inside a face run in opposite directions.
    inner = ~outer
    forwards = made.corner_vertices < made.corner_vertices[following(made)]
    directions = np.bincount(made.corner_edges[inner], np.where(forwards, 1, -1)[inner], len(made.edge_vertices))
    assert np.all(directions == 0)


def assert_same_topology(base: PolygonMesh, made: SubdividedMesh) -> None:
    """Euler characteristic and connected components, by vertices and by edges, are those of the base mesh."""
    euler = len(made.positions) - len(made.edge_vertices) + len(made.base_faces)
    assert euler == base.vertex_count - base.edge_count + base.face_count
    for name in ("corner_vertices", "corner_edges"):
        assert components(corner_faces(made), getattr(made, name)) == components(base.corner_faces, getattr(base, name))


def components(faces: IndexArray, through: IndexArray) -> int:
    """Of faces that hang together through what their corners stand at."""
    count = faces.max() + 1
    graph = coo_matrix((np.ones(len(faces)), (faces, count + through)), shape=(count + through.max() + 1,) * 2)
    _, labels = connected_components(graph, directed=False)
    return len(np.unique(labels[:count]))


def in_square(base: PolygonMesh, points: SurfacePoints) -> FloatArray:
    """(N, 2): points of quads in the unit square, whose corners 0 to 3 are those of the quad; of others, nothing."""
    place = (points.corners - base.face_starts[base.corner_faces[points.corners]]) % 4
    here, after, before = SQUARE[place], SQUARE[(place + 1) % 4], SQUARE[place - 1]
    u, v = points.parameters[:, :1], points.parameters[:, 1:]
    return here + (u * (after - here) + v * (before - here)) / 2


def on_polygon(base: PolygonMesh, points: SurfacePoints) -> FloatArray:
    """(N, 2): points on the border of any face, on that of a regular polygon."""
    half_edges, where = along_half_edges(base, points)
    side = np.where(half_edges[:, 0] >= 0, 0, 1)
    chosen = np.arange(len(side)), side
    faces = base.corner_faces[points.corners]
    assert np.all(half_edges[chosen] >= 0)
    turn = 2 * np.pi / base.face_sizes[faces]
    angles = (half_edges[chosen] - base.face_starts[faces]) * turn
    start, end = (np.stack([np.cos(each), np.sin(each)], axis=1) for each in (angles, angles + turn))
    t = where[chosen][:, None]
    return (1 - t) * start + t * end


def plane_areas(made: SubdividedMesh, places: FloatArray) -> FloatArray:
    """(F,) of polygons with corners at places (C, 2), positive where they go round counter-clockwise."""
    x, y = places.T
    after = following(made)
    return np.add.reduceat(x * y[after] - x[after] * y, made.face_starts[:-1]) / 2


def assert_covers_each_face_once(base: PolygonMesh, made: SubdividedMesh) -> None:
    """All faces turn as their base faces do, and their areas add up to these', exactly on quads and their children."""
    is_quad = base.face_sizes == 4
    areas = plane_areas(made, in_square(base, made.corner_points))
    of_quads = is_quad[made.base_faces]
    assert np.all(areas[of_quads] > 0)
    sums = np.bincount(made.base_faces[of_quads], areas[of_quads], base.face_count)
    assert np.all(sums[is_quad] == 1)

    first = made.corner_points.corners[made.face_starts[:-1]]
    in_quarter = np.logical_and.reduceat(
        made.corner_points.corners == np.repeat(first, sizes(made)), made.face_starts[:-1]
    )
    areas = plane_areas(made, made.corner_points.parameters)
    quarters = in_quarter & ~of_quads
    assert np.all(areas[quarters] > 0)
    sums = np.bincount(first[quarters], areas[quarters], base.corner_count)
    whole = np.unique(made.base_faces[~in_quarter & ~of_quads])
    of_whole = np.isin(base.corner_faces, whole)
    assert np.all(sums[~of_whole & ~is_quad[base.corner_faces]] == 1)
    assert np.all(sums[of_whole] == 0)
    assert_covers_whole_polygons(base, made, whole)


def assert_covers_whole_polygons(base: PolygonMesh, made: SubdividedMesh, whole: IndexArray) -> None:
    """The same for faces that are no quads and were not split."""
    places = np.zeros((len(made.corner_vertices), 2))
    corners = np.flatnonzero(np.isin(base.corner_faces[made.corner_points.corners], whole))
    places[corners] = on_polygon(base, made.corner_points.at(corners))
    areas = plane_areas(made, places)
    of_whole = np.isin(made.base_faces, whole)
    assert np.all(areas[of_whole] > AREA_ROUNDING)
    sums = np.bincount(made.base_faces[of_whole], areas[of_whole], base.face_count)[whole]
    count = base.face_sizes[whole]
    np.testing.assert_allclose(sums, count * np.sin(2 * np.pi / count) / 2, rtol=AREA_ROUNDING)


def assert_no_vertex_inside_sides(base: PolygonMesh, made: SubdividedMesh) -> None:
    """No vertex stands inside the side of a face, on a quarter of it: sides that are balanced have none elsewhere.

    Sides inside quads, and inside the quarters of other faces; those along base edges are equal on both sides.
    """
    is_quad = base.face_sizes[base.corner_faces[made.corner_points.corners]] == 4
    after = following(made)
    same = made.corner_points.corners == made.corner_points.corners[after]
    of_quad = base.corner_faces[made.corner_points.corners]
    square, own = in_square(base, made.corner_points), made.corner_points.parameters
    for alike, wanted, group, places in (
        (is_quad, is_quad, of_quad, square),
        (~is_quad, ~is_quad & same, made.corner_points.corners, own),
    ):
        stands = place_keys(group[alike], places[alike])
        starts, ends = places[wanted], places[after[wanted]]
        for part in (0.25, 0.5, 0.75):
            inside = place_keys(group[wanted], starts + part * (ends - starts))
            assert not np.any(np.isin(inside, stands))


def place_keys(groups: IndexArray, places: FloatArray) -> NDArray[np.int64]:
    """(N,) one number for each place (N, 2) of a group, exactly, to level ``DEEPEST``."""
    scaled = np.ldexp(places, DEEPEST)
    whole = scaled.astype(np.int64)
    assert np.array_equal(whole, scaled)
    return (groups << 2 * DEEPEST + 2) + (whole[:, 0] << DEEPEST + 1) + whole[:, 1]


def assert_nothing_degenerate(made: SubdividedMesh) -> None:
    """No vertex doubled, no face without area."""
    diagonal = np.linalg.norm(np.ptp(made.positions, axis=0))
    assert not cKDTree(made.positions).query_pairs(SAME_POINT * diagonal)
    normals, longest = newell_normals(made)
    assert np.all(np.linalg.norm(normals, axis=1) > LEAST_AREA * longest**2)


def newell_normals(made: SubdividedMesh) -> tuple[FloatArray, FloatArray]:
    """(F, 3) normals as long as the faces are large, and (F,) their longest sides."""
    starts = made.face_starts[:-1]
    points = made.positions[made.corner_vertices]
    middles = np.add.reduceat(points, starts) / sizes(made)[:, None]
    around = points - np.repeat(middles, sizes(made), axis=0)
    normals = np.add.reduceat(np.cross(around, around[following(made)]), starts) / 2
    lengths = np.linalg.norm(points[following(made)] - points, axis=1)
    return normals, np.maximum.reduceat(lengths, starts)
