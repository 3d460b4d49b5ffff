# SPDX-License-Identifier: GPL-3.0-or-later
"""Test meshes as plain arrays, for the core and for Blender alike."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule, crease_to_sharpness

EdgeCreases = dict[tuple[int, int], float]


@dataclass(frozen=True)
class MeshData:
    """positions (V, 3); face_sizes (F,); corner_vertices (sum of sizes,); creases as Blender has them, 0 to 1."""

    positions: NDArray[np.float64]
    face_sizes: NDArray[np.intp]
    corner_vertices: NDArray[np.intp]
    edge_creases: EdgeCreases = field(default_factory=dict)
    vertex_creases: dict[int, float] = field(default_factory=dict)
    loose_edges: list[tuple[int, int]] = field(default_factory=list)

    @cached_property
    def faces(self) -> list[list[int]]:
        return [face.tolist() for face in np.split(self.corner_vertices, np.cumsum(self.face_sizes)[:-1])]

    @property
    def edges(self) -> NDArray[np.intp]:
        """(E, 2), each edge that has faces once, the lower vertex first."""
        ends = np.cumsum(self.face_sizes)
        following = np.arange(1, len(self.corner_vertices) + 1)
        following[ends - 1] = ends - self.face_sizes
        pairs = np.stack([self.corner_vertices, self.corner_vertices[following]], axis=1)
        return np.unique(np.sort(pairs, axis=1), axis=0)


def from_faces(positions: object, faces: list[list[int]]) -> MeshData:
    sizes = np.array([len(face) for face in faces], dtype=np.intp)
    return MeshData(np.array(positions, dtype=np.float64), sizes, np.concatenate(faces).astype(np.intp))


def single_precision(data: MeshData) -> MeshData:
    """The mesh as Blender holds it."""
    return replace(data, positions=data.positions.astype(np.float32).astype(np.float64))


def to_polygon_mesh(data: MeshData) -> PolygonMesh:
    """The core's mesh of it, its loose edges left out; no boundary rule applied."""
    creases = np.zeros(len(data.positions))
    creases[list(data.vertex_creases)] = list(data.vertex_creases.values())
    sharpness = crease_to_sharpness(np.array(list(data.edge_creases.values())))
    return polygon_mesh(
        data.positions,
        data.face_sizes,
        data.corner_vertices,
        sharp_edges=dict(zip(data.edge_creases, sharpness.tolist(), strict=True)),
        vertex_sharpness=crease_to_sharpness(creases),
    )


def build(data: MeshData, *, smooth_corners: bool = True) -> PolygonMesh:
    """The core's mesh of it, with the boundary rule applied."""
    return apply_boundary_rule(to_polygon_mesh(data), smooth_corners=smooth_corners)


def diagonal(mesh: MeshData | PolygonMesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))


def bent(data: MeshData, change: Callable[..., Sequence[NDArray[np.float64]]]) -> MeshData:
    """With its points moved: change of (V,) x, y and z gives the new ones."""
    return replace(data, positions=np.stack(change(*data.positions.T), axis=1))


def cube() -> MeshData:
    """Side 2, around the origin; vertex 4x + 2y + z at (±1, ±1, ±1)."""
    positions = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return from_faces(positions, faces)


def grid(columns: int, rows: int) -> MeshData:
    """columns × rows unit quads in the plane z = 0; vertex (x, y) is y (columns + 1) + x."""
    y, x = np.mgrid[: rows + 1, : columns + 1]
    positions = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float64)
    index = np.arange((columns + 1) * (rows + 1)).reshape(rows + 1, columns + 1)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)
    return MeshData(positions, np.full(columns * rows, 4), quads.reshape(-1))


def hexagons(columns: int, rows: int, noise: float = 0.0, seed: int = 1) -> MeshData:
    """A honeycomb in the plane z = 0, vertices moved within the plane. By more than 0.15 some hexagons are dented."""
    own = grid(2 * columns + 1, rows).positions
    own[:, 1] += np.where(own.sum(axis=1) % 2 == 0, 0.15, -0.15)
    own[:, :2] += np.random.default_rng(seed).uniform(-noise, noise, (len(own), 2))
    index = np.arange(len(own)).reshape(rows + 1, -1)
    at = [
        (row, slice(row % 2 + 2 * column, row % 2 + 2 * column + 3)) for row in range(rows) for column in range(columns)
    ]
    faces = [[*index[row, along], *index[row + 1, along][::-1]] for row, along in at]
    used, corners = np.unique(np.array(faces), return_inverse=True)
    return MeshData(own[used], np.full(len(faces), 6), corners.reshape(-1))


def hexagons_with_a_bump() -> MeshData:
    """Flat but for a bump near the border."""
    data = hexagons(6, 11, 0.12)
    away = np.linalg.norm(data.positions[:, :2] - (4.0, 3.0), axis=1)
    return replace(data, positions=data.positions + np.maximum(2.0 - away, 0.0)[:, None] * (0.0, 0.0, 0.5))


def landscape(columns: int, rows: int, seed: int = 1) -> MeshData:
    """A grid with hills and some noise on them."""
    noise = np.random.default_rng(seed).uniform(-0.2, 0.2, (columns + 1) * (rows + 1))
    return bent(grid(columns, rows), lambda x, y, _: (x, y, np.sin(0.9 * x) * np.cos(0.6 * y) + noise))


def bent_plate() -> MeshData:
    """A plate with an uneven grid, flat but for an end, where it is bent down."""
    data = grid(10, 5)
    x, y, _ = data.positions.T - [[5], [0], [0]]
    angles, is_flat = np.clip(x - 1, 0, None) / 3, x <= 1
    off = np.random.default_rng(1).uniform(-0.3, 0.3, (2, len(x))) * is_flat
    z = np.where(is_flat, 0, 3 * np.cos(angles) - 3)
    positions = np.stack([np.where(is_flat, x, 1 + 3 * np.sin(angles)) + off[0], y + off[1], z], axis=1)
    return single_precision(replace(data, positions=positions))


def torus(major: int, minor: int) -> MeshData:
    """major × minor quads, all vertices regular; radii 2 and 0.75."""
    i, j = np.mgrid[:major, :minor]
    around, across = 2 * np.pi * i / major, 2 * np.pi * j / minor
    radius = 2 + 0.75 * np.cos(across)
    positions = np.stack([radius * np.cos(around), radius * np.sin(around), 0.75 * np.sin(across)], axis=-1)
    index = np.arange(major * minor).reshape(major, minor)
    right, up = np.roll(index, -1, axis=0), np.roll(index, -1, axis=1)
    quads = np.stack([index, right, np.roll(right, -1, axis=1), up], axis=-1)
    return MeshData(positions.reshape(-1, 3), np.full(major * minor, 4), quads.reshape(-1))


def cylinder(sides: int, profile: Sequence[tuple[float, float]] = ((1.0, -1.0), (1.0, 1.0))) -> MeshData:
    """Quads around, an n-gon at each end. profile: radii and heights, upwards."""
    positions = [(r * np.cos(t), r * np.sin(t), z) for r, z in profile for t in 2 * np.pi * np.arange(sides) / sides]
    rings = np.arange(len(positions)).reshape(-1, sides)
    right = np.roll(rings, -1, axis=1)
    quads = np.stack([rings[:-1], right[:-1], right[1:], rings[1:]], axis=-1).reshape(-1, 4)
    return from_faces(positions, [*quads.tolist(), rings[0, ::-1].tolist(), rings[-1].tolist()])


def sphere(columns: int, rows: int) -> MeshData:
    """With poles of triangles; of two rows it is all triangles, around a belt of vertices of valence 4."""
    turns, heights = np.arange(columns) * 2 * np.pi / columns, np.arange(1, rows) * np.pi / rows
    positions = [(np.sin(h) * np.cos(t), np.sin(h) * np.sin(t), np.cos(h)) for h in heights for t in turns]
    rings = np.arange(len(positions)).reshape(-1, columns)
    right, pole = np.roll(rings, -1, axis=1), np.full(columns, len(positions))
    quads = np.stack([rings[:-1], rings[1:], right[1:], right[:-1]], axis=-1).reshape(-1, 4)
    caps = np.stack([[pole, rings[0], right[0]], [pole + 1, right[-1], rings[-1]]]).swapaxes(1, 2).reshape(-1, 3)
    return from_faces([*positions, (0, 0, 1), (0, 0, -1)], quads.tolist() + caps.tolist())


def fan(valence: int, rings: int = 2, seed: int = 1) -> MeshData:
    """An open, slightly bumpy mesh of quads around vertex 0, the only irregular one inside, of any valence from 2 up.

    Each of the ``valence`` sectors is a grid of rings × rings quads; the border is a boundary.
    """
    numbers: dict[tuple[int, int, int], int] = {}
    positions: list[list[float]] = []

    def number(sector: int, i: int, j: int) -> int:
        if i == 0 and j > 0:
            sector, i, j = sector + 1, j, 0
        key = (sector % valence, i, j) if i else (0, 0, 0)
        if key not in numbers:
            numbers[key] = len(positions)
            angle = 2 * np.pi / valence * (key[0] + (j / (i + j) if j else 0.0))
            radius = np.hypot(i, j)
            positions.append([radius * np.cos(angle), radius * np.sin(angle), 0.0])
        return numbers[key]

    quads = [
        [number(sector, i, j), number(sector, i + 1, j), number(sector, i + 1, j + 1), number(sector, i, j + 1)]
        for sector in range(valence)
        for i in range(rings)
        for j in range(rings)
    ]
    data = from_faces(positions, quads)
    heights = np.random.default_rng(seed).uniform(-0.3, 0.3, len(positions))
    return replace(data, positions=data.positions + heights[:, None] * [0.2, 0.1, 1.0])


def around_quad(valences: tuple[int, int, int, int]) -> MeshData:
    """A flat quad, face 0, with corners of these valences from its first on, and the quads around it."""
    faces, points = [[0, 1, 2, 3]], [np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])]
    rings, count = [], 4
    for corner, valence in enumerate(valences):
        # A quarter turn from beyond the side after the corner to beyond the side before it.
        size = 2 * valence - 5
        parts = np.linspace(0.0, 1.0, size) if size > 1 else np.array([0.5])
        angles = np.pi / 2 * (corner - 1 - parts)
        reach = np.where(np.arange(size) % 2 == 0, 1.0, 1.4)[:, None]
        points.append(points[0][corner] + reach * np.stack([np.cos(angles), np.sin(angles)], axis=1))
        rings.append(list(range(count, count + size)))
        count += size
    for corner, ring in enumerate(rings):
        following = (corner + 1) % 4
        faces.append([following, corner, ring[0], rings[following][-1]])
        faces += [[corner, ring[i], ring[i - 1], ring[i - 2]] for i in range(2, len(ring), 2)]
    places = np.concatenate(points)
    return from_faces(np.column_stack([places, np.zeros(len(places))]), faces)


def valence_two() -> MeshData:
    """An open mesh with one vertex of valence 2 inside, vertex 0 with the edges (0, 1) and (0, 3)."""
    return fan(2, 3)


def triangles_and_quads() -> MeshData:
    """A closed house: a box of quads under a roof of two triangles and two quads."""
    positions = [[x, y, z] for z in (0.0, 1.5) for x, y in ((-1, -2), (1, -2), (1, 2), (-1, 2))]
    positions += [[0, -1.5, 2.5], [0.1, 1.5, 2.7]]
    sides = [[0, 3, 2, 1], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return from_faces(positions, [*sides, [4, 5, 8], [6, 7, 9], [5, 6, 9, 8], [7, 4, 8, 9]])


def bumpy(data: MeshData, size: float, seed: int = 1) -> MeshData:
    """The mesh with every coordinate off by up to ``size``, so that nothing about it is symmetric."""
    noise = np.random.default_rng(seed).uniform(-size, size, data.positions.shape)
    return replace(data, positions=data.positions + noise)


def trapezohedron(sides: int) -> MeshData:
    """A closed mesh of 2 sides kites around two poles of valence ``sides``; all other vertices have valence 3."""
    angles = np.pi * np.arange(2 * sides) / sides
    height = np.where(np.arange(2 * sides) % 2 == 0, 0.25, -0.25)
    belt = np.column_stack([np.cos(angles), np.sin(angles), height])
    top, bottom, count = 2 * sides, 2 * sides + 1, 2 * sides
    upper = [[top, i, i + 1, (i + 2) % count] for i in range(0, count, 2)]
    lower = [[bottom, i, i - 1, (i - 2) % count] for i in range(1, count, 2)]
    return from_faces([*belt.tolist(), [0, 0, 1], [0, 0, -1]], upper + lower)


def welded(data: MeshData, other: MeshData, pairs: dict[int, int]) -> MeshData:
    """Both meshes in one, vertex ``b`` of the other being vertex ``a`` of the first for each ``b: a`` in ``pairs``."""
    count = len(data.positions)
    own = [vertex for vertex in range(len(other.positions)) if vertex not in pairs]
    renumbered = np.zeros(len(other.positions), dtype=np.intp)
    renumbered[own] = count + np.arange(len(own))
    renumbered[list(pairs)] = list(pairs.values())
    moved = {(int(renumbered[a]), int(renumbered[b])): crease for (a, b), crease in other.edge_creases.items()}
    return MeshData(
        positions=np.concatenate([data.positions, other.positions[own]]),
        face_sizes=np.concatenate([data.face_sizes, other.face_sizes]),
        corner_vertices=np.concatenate([data.corner_vertices, renumbered[other.corner_vertices]]),
        edge_creases=data.edge_creases | moved,
        vertex_creases=data.vertex_creases | {int(renumbered[v]): crease for v, crease in other.vertex_creases.items()},
    )


def moved(data: MeshData, x: float, y: float = 0.0, z: float = 0.0) -> MeshData:
    return replace(data, positions=data.positions + np.array([x, y, z]))


def two_cubes_sharing_an_edge() -> MeshData:
    return welded(cube(), moved(cube(), 2.0, 2.0), {0: 6, 1: 7})


def two_cubes_sharing_a_vertex() -> MeshData:
    return welded(cube(), moved(cube(), 2.0, 2.0, 2.0), {0: 7})


def bow_tie() -> MeshData:
    """Two quads that share only a vertex."""
    return welded(grid(1, 1), moved(grid(1, 1), 1.0, 1.0, 0.3), {0: 3})


def bow_tie_inside() -> MeshData:
    """Two surfaces that touch in a vertex that lies inside both."""
    cone = grid(2, 2)
    tip = np.where((np.arange(9) == 4)[:, None], [0.0, 0.0, 1.0], 0.0)
    above = moved(replace(cone, positions=cone.positions - tip), 0.0, 0.0, 2.0)
    return welded(replace(cone, positions=cone.positions + tip), above, {4: 4})


def three_faces_on_an_edge() -> MeshData:
    """A grid with a fin standing on one of its edges."""
    data = landscape(4, 3)
    fin = from_faces([[0, 0, 0], [1, 0, 0], [1.2, 0.2, 1.5], [0.1, -0.1, 1.2]], [[0, 1, 2, 3]])
    return welded(data, moved(fin, 1.0, 1.0), {0: 6, 1: 7})


def fin_through() -> MeshData:
    """Three half-planes on a line: an interior non-manifold crease with ends on the boundary."""
    upright = bent(moved(grid(4, 2), 0.0, 2.0), lambda x, z, y: (x, y + 0.1, z))
    return welded(landscape(4, 4), upright, {column: 10 + column for column in range(5)})


def boundary_touching_inside() -> MeshData:
    """The corner of one surface touches a vertex that lies inside another."""
    return welded(landscape(4, 4), moved(grid(2, 2), 2.0, 2.0, 1.0), {0: 12})


def face_soup(seed: int = 1, share: float = 0.35) -> MeshData:
    """Random faces of a 3 × 3 × 3 lattice of boxes, turned at random: every way to be non-manifold, inside and out."""
    generator = np.random.default_rng(seed)
    index = np.arange(64).reshape(4, 4, 4)
    faces = []
    for axis in range(3):
        layers = np.moveaxis(index, axis, 0)
        quads = np.stack([layers[:, :-1, :-1], layers[:, 1:, :-1], layers[:, 1:, 1:], layers[:, :-1, 1:]], axis=-1)
        faces += [quad if generator.random() < 0.8 else quad[::-1] for quad in quads.reshape(-1, 4)]
    chosen = [face.tolist() for face in faces if generator.random() < share]
    positions = np.indices((4, 4, 4)).reshape(3, -1).T + generator.uniform(-0.2, 0.2, (64, 3))
    return from_faces(positions, chosen)


def flipped_face() -> MeshData:
    """A landscape with one face inside that is turned round."""
    data = landscape(4, 4)
    quads = data.corner_vertices.reshape(-1, 4).copy()
    quads[5] = quads[5, ::-1]
    return replace(data, corner_vertices=quads.reshape(-1))


def mobius_strip(segments: int = 7) -> MeshData:
    """A band two quads wide, whose ends meet turned over: its faces cannot all be oriented alike."""
    turn = 2 * np.pi * np.repeat(np.arange(segments), 3) / segments
    across = np.tile([-0.6, 0.0, 0.6], segments)
    radius = 2 + across * np.cos(turn / 2)
    positions = np.stack([radius * np.cos(turn), radius * np.sin(turn), across * np.sin(turn / 2)], axis=1)
    rows = np.arange(3 * segments).reshape(-1, 3)
    following = np.concatenate([rows[1:], rows[:1, ::-1]])
    quads = np.stack([rows[:, :-1], rows[:, 1:], following[:, 1:], following[:, :-1]], axis=-1)
    return MeshData(positions, np.full(2 * segments, 4), quads.reshape(-1))


def two_quads_on_opposite_corners() -> MeshData:
    """Two quads that share two opposite corners, and no edge."""
    positions = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0.2, 0.8], [0, 1, 0.7]]
    return from_faces(positions, [[0, 1, 2, 3], [0, 4, 2, 5]])


def ring_of_quads_on_opposite_corners() -> MeshData:
    """Four quads around one pair of opposite corners, each sharing two edges with the next."""
    positions = [[0, 0, 0], [1, 0, 0.5], [1, 1, 0], [0, 1, 0.5], [1, 0, -0.5], [0, 1, -0.5]]
    return from_faces(positions, [[0, 1, 2, 3], [0, 3, 2, 5], [0, 5, 2, 4], [0, 4, 2, 1]])


def pillow(size: int) -> MeshData:
    """Two faces, back to back, on the same bent ring of vertices."""
    angles = 2 * np.pi * np.arange(size) / size
    positions = np.stack([np.cos(angles), np.sin(angles), 0.3 * np.cos(2 * angles)], axis=1)
    ring = list(range(size))
    return from_faces(positions, [ring, ring[::-1]])


def tetrahedron() -> MeshData:
    return from_faces([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def concave_faces() -> MeshData:
    """A concave pentagon, a dart and plain quads in one roof."""
    positions = [[0, 0, 0], [2, 0, 0], [2, 2, 0.2], [1, 0.5, 0], [0, 2, 0], [0, 0, -1], [2, 0, -1], [1, 3, 0.1]]
    return from_faces(positions, [[0, 1, 2, 3, 4], [1, 0, 5, 6], [4, 3, 2, 7]])


def loose_edge_at_a_face_vertex() -> MeshData:
    """A landscape; loose edges at a vertex inside, at one on the border, and one far away."""
    data = landscape(4, 4)
    loose = [[2.0, 2.0, 3.0], [-1.0, 2.0, 0.0], [8.0, 0.0, 0.0], [9.0, 0.0, 0.0]]
    count = len(data.positions)
    edges = [(12, count), (10, count + 1), (count + 2, count + 3)]
    return replace(data, positions=np.concatenate([data.positions, loose]), loose_edges=edges)


def with_collapsed_faces(data: MeshData) -> MeshData:
    """Faces without area, far apart: one collapsed to a point, one to a line, one with an edge of no length."""
    positions = data.positions.copy()
    starts = np.concatenate([[0], np.cumsum(data.face_sizes)])
    point, line, edge = (
        data.corner_vertices[starts[face] : starts[face + 1]]
        for face in (0, len(data.face_sizes) // 2, len(data.face_sizes) - 1)
    )
    positions[point] = positions[point].mean(axis=0)
    first, second = positions[line[:2]]
    positions[line[2:]] = first + np.linspace(0.75, 0.25, len(line) - 2)[:, None] * (second - first)
    positions[edge[0]] = positions[edge[1]]
    return replace(data, positions=positions)


def creased(data: MeshData, edges: EdgeCreases, vertices: dict[int, float] | None = None) -> MeshData:
    return replace(data, edge_creases=edges, vertex_creases=vertices or {})


def creased_cube() -> MeshData:
    """A cube with creases 0.3, 0.7 and 1.0: a closed loop, an open chain, and edges that meet in one vertex."""
    loop = {(0, 1): 0.7, (1, 3): 0.7, (2, 3): 0.3, (0, 2): 1.0}
    return creased(cube(), loop | {(4, 5): 0.3, (5, 7): 1.0, (0, 4): 0.3})


def cube_creased_around_the_top(crease: float) -> MeshData:
    return creased(cube(), dict.fromkeys(((1, 3), (3, 7), (5, 7), (1, 5)), crease))


def corner_creased_cube() -> MeshData:
    return creased(cube(), {(0, 1): 0.5}, {0: 0.3, 3: 0.7, 5: 1.0, 6: 0.45})


def softened(data: MeshData) -> MeshData:
    """With less of the creases that are not 1, so that the last semi-sharp rule has run out by level 2."""
    edges = {ends: crease if crease == 1 else 0.4 * crease for ends, crease in data.edge_creases.items()}
    vertices = {vertex: crease if crease == 1 else 0.4 * crease for vertex, crease in data.vertex_creases.items()}
    return creased(data, edges, vertices)


def with_random_creases(data: MeshData, seed: int = 1, share: float = 0.3) -> MeshData:
    """Random creases on a share of the edges and vertices, a quarter of them 1.0, a quarter 0.25 or 0.5."""
    generator = np.random.default_rng(seed)

    def creases(count: int) -> NDArray[np.float64]:
        values = generator.uniform(0.05, 1.0, count).astype(np.float32).astype(np.float64)
        kind = generator.integers(0, 4, count)
        equal = generator.choice([0.25, 0.5], count)
        return np.where(kind == 0, 1.0, np.where(kind == 1, equal, values))

    edges = data.edges
    edges = edges[generator.random(len(edges)) < share]
    vertices = np.flatnonzero(generator.random(len(data.positions)) < share / 4)
    return creased(
        data,
        {(int(a), int(b)): crease for (a, b), crease in zip(edges, creases(len(edges)).tolist(), strict=True)},
        dict(zip(vertices.tolist(), creases(len(vertices)).tolist(), strict=True)),
    )


# Heights found by linear programming


def torus_with_a_late_face() -> MeshData:
    """5 × 5 faces. With limit vertices face 12 is within 1.1 of the surface at level 0 and beyond it at level 1, where
    all others are within it."""
    heights = [
        0.0, 21.32, 9.65, 32.56, 31.74, 21.32, 0.29, 42.32, 36.29, 7.86, 9.65, 42.32, 6.88, 44.62, 23.31,
        32.56, 36.29, 44.62, 48.38, 48.57, 31.74, 7.86, 23.31, 48.57, 46.36,
    ]  # fmt: skip
    return with_heights(torus(5, 5), heights)


def grid_with_a_late_face() -> MeshData:
    """3 × 3 faces. The middle one is within about 1.1 at levels 0 and 3, and not between."""
    heights = [
        284.37, 0.0, 0.0, 279.31, 0.0, 73.76, 122.23, 79.61, 0.0, 122.23, 249.51, 467.88, 279.31, 79.61,
        467.88, 0.0,
    ]  # fmt: skip
    return with_heights(grid(3, 3), heights)


def with_heights(data: MeshData, heights: list[float]) -> MeshData:
    return replace(data, positions=np.column_stack([data.positions[:, :2], heights]))


AWKWARD: dict[str, Callable[[], MeshData]] = {
    "cube": cube,
    "triangles": lambda: bumpy(sphere(7, 2), 0.1),
    "triangles and quads": triangles_and_quads,
    "cylinder": lambda: cylinder(9),
    "landscape": lambda: landscape(5, 4),
    "single quad": lambda: bumpy(grid(1, 1), 0.3),
    "collapsed faces": lambda: with_collapsed_faces(landscape(5, 4)),
    "collapsed n-gons": lambda: with_collapsed_faces(cylinder(7)),
    "valences 2 and 12": lambda: welded(valence_two(), moved(fan(12), 10.0), {}),
    "valence 2 creased": lambda: with_random_creases(valence_two(), seed=5, share=0.8),
    "creased cube": creased_cube,
    "corner creased cube": corner_creased_cube,
    "landscape with random creases": lambda: with_random_creases(landscape(5, 5), share=0.5),
    "cylinder with random creases": lambda: with_random_creases(cylinder(8), share=0.6),
    "two cubes sharing an edge": two_cubes_sharing_an_edge,
    "two cubes sharing a vertex": two_cubes_sharing_a_vertex,
    "bow tie": bow_tie,
    "bow tie inside": bow_tie_inside,
    "three faces on an edge": three_faces_on_an_edge,
    "fin through": fin_through,
    "flipped face": flipped_face,
    "soup": face_soup,
    "soup with random creases": lambda: with_random_creases(face_soup(2), seed=2, share=0.4),
    "boundary touching inside": boundary_touching_inside,
}
