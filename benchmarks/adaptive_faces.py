# SPDX-License-Identifier: GPL-3.0-or-later
"""The faces of adaptive subdivision, next to ideal quadtrees and to one level for all.

python benchmarks/adaptive_faces.py -- [NAME…]        with the bpy wheel

An ideal quadtree splits a quad while it misses the tolerance, without regard to neighbours. The distance of a quad is
sampled at 17 × 17 points of the surface, in two ways:

- facet: the bilinear facet's largest distance at equal parameters, and a quarter of the part of its twist that stands
  on its plane, as in the definition of the ideal quadtree;
- drawn: the largest distance of the better pair of triangles at equal parameters.

Faces are all faces made, transitions included; leaves are the leaves of the balanced quadtree. Then come meshes as
people model them, and hard ones, with faces and seconds of processor over those of ``BEFORE``, and the distance that
Measure Deviation reaches and the one it proves, in parts of the tolerance. Exits with 1 where a line does not hold.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # isort: skip
import bmesh
import numpy as np
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

from ccdepth_addon.core.adaptive.plan import TooManyFacesError
from ccdepth_addon.core.adaptive.planner import subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes
from tests.blender import scene
from tests.blender.named_meshes import NAMED

RELATIVE_TOLERANCES = (1e-2, 1e-3, 3e-4)
MOST_FACES = 3_000_000
STEPS = 16

# Suzanne after one step: the most faces there may be.
LINES = {1e-3: 9_000, 3e-4: 29_000}
MOST_OVER_IDEAL = 1.25

# Modelled and hard meshes: tolerances, in parts of the diagonal or, if negative, as lengths; and the faces and seconds
# of processor time before leaves were bounded in shells. A row allows 1.05 times as many faces.
BEFORE: dict[str, dict[float, tuple[int, float]]] = {
    "bevelled cube": {1e-3: (552, 0.07), 3e-4: (1_800, 0.06)},
    "bevelled cylinder": {1e-3: (2_752, 0.10), 3e-4: (5_088, 0.09)},
    "Suzanne after one step": {1e-3: (4_638, 0.31), 3e-4: (15_042, 0.39)},
    "torus 12 x 8": {1e-3: (1_680, 0.01), 3e-4: (5_184, 0.02)},
    "torus 16 x 12": {1e-3: (1_792, 0.02), 3e-4: (4_864, 0.03)},
    "n-gons": {1e-3: (2_136, 0.06), 3e-4: (5_664, 0.12)},
    "planar triangles": {1e-3: (572, 1.61), 1e-4: (1_510, 2.01)},
    "random triangles, 500": {-2e-4: (51_176, 3.38)},
    "random triangles, 2,000": {-2e-4: (104_203, 7.13)},
    "random triangles, 16,000": {-2e-4: (274_936, 30.59)},
    "Suzanne after three steps": {-2e-5: (615_598, 5.61)},
    "mechanical part": {1e-3: (3_264, 0.18), 3e-4: (7_424, 0.32)},
    "thin triangles": {1e-3: (2_784, 0.55), 3e-4: (7_172, 0.90)},
    "torus 24 x 12": {1e-3: (1_632, 0.01), 3e-4: (5_952, 0.03)},
    "landscape": {1e-3: (1_851, 0.05), 3e-4: (5_851, 0.09)},
}
MOST_OVER_BEFORE = 1.05
ACCURACY = 0.05

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


# Ideal quadtrees, and uniform levels


@dataclass(frozen=True)
class Quads:
    """Squares in the quarters of the mesh's faces: the quarter's corner, the square's lower corner, and its side; or
    whole quads, side 2, with the face's first corner."""

    corners: IndexArray
    origins: FloatArray
    side: float


def quads_of(mesh: PolygonMesh) -> Quads:
    """The first squares of ideal quadtrees: whole quads, and the quarters of other faces."""
    is_quad = mesh.face_sizes == 4
    whole = mesh.face_starts[:-1][is_quad]
    return Quads(whole, np.zeros((len(whole), 2)), 2.0)


def quarters_of(mesh: PolygonMesh, faces: IndexArray) -> Quads:
    """The quarters of some faces."""
    corners = np.flatnonzero(np.isin(mesh.corner_faces, faces))
    return Quads(corners, np.zeros((len(corners), 2)), 1.0)


def surface_grid(mesh: PolygonMesh, quads: Quads) -> FloatArray:
    """(quads, STEPS + 1, STEPS + 1, 3): the surface at equal steps, u along the second axis."""
    along = np.linspace(0.0, 1.0, STEPS + 1)
    grid = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    places = (quads.origins[:, None] + quads.side * grid).reshape(-1, 2)
    corners = np.repeat(quads.corners, len(grid))
    points = _over_whole_quads(corners, places) if quads.side == 2 else SurfacePoints(corners, places)
    return limit_values(mesh, mesh.positions, points).reshape(-1, STEPS + 1, STEPS + 1, 3)


def _over_whole_quads(first: IndexArray, places: FloatArray) -> SurfacePoints:
    """Places in [0, 2]² of whole quads, as points in their quarters."""
    right, upper = places[:, 0] > 1, places[:, 1] > 1
    place = np.where(upper, np.where(right, 2, 3), np.where(right, 1, 0))
    offsets = places - 2 * SQUARE[place]
    along, across = SQUARE[(place + 1) % 4] - SQUARE[place], SQUARE[place - 1] - SQUARE[place]
    return SurfacePoints(
        first + place, np.stack([(offsets * along).sum(axis=1), (offsets * across).sum(axis=1)], axis=1)
    )


def missed(surface: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(quads,) twice: the distances of facets, and of triangles."""
    corners = surface[:, [0, -1, -1, 0], [0, 0, -1, -1]]
    a, b, c, d = (corners[:, corner, None, None] for corner in range(4))
    along = np.linspace(0.0, 1.0, STEPS + 1)
    u, v = (each[None, :, :, None] for each in np.meshgrid(along, along, indexing="ij"))
    bilinear = (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c)
    twist = a - b - d + c
    normals = np.cross((c - a)[:, 0, 0], (d - b)[:, 0, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
    # B - T on the two sides of the first diagonal, and of the second.
    first = np.where(u >= v, -v * (1 - u), -u * (1 - v)) * twist
    second = np.where(u + v <= 1, u * v, (1 - u) * (1 - v)) * twist
    facet = _largest(surface - bilinear) + np.abs(np.einsum("ij,ij->i", normals, twist[:, 0, 0])) / 4
    return facet, np.minimum(_largest(surface - bilinear + first), _largest(surface - bilinear + second))


def _largest(vectors: FloatArray) -> FloatArray:
    return np.linalg.norm(vectors, axis=-1).max(axis=(1, 2))


def children(mesh: PolygonMesh, quads: Quads, split: np.ndarray) -> Quads:
    chosen = np.flatnonzero(split)
    if quads.side == 2:
        return quarters_of(mesh, mesh.corner_faces[quads.corners[chosen]])
    origins = quads.origins[chosen, None] + quads.side / 2 * SQUARE
    return Quads(np.repeat(quads.corners[chosen], 4), origins.reshape(-1, 2), quads.side / 2)


QUADS_AT_ONCE = 1 << 12


def missed_by_all(mesh: PolygonMesh, quads: Quads) -> tuple[FloatArray, FloatArray]:
    blocks = [
        missed(surface_grid(mesh, Quads(quads.corners[block], quads.origins[block], quads.side)))
        for start in range(0, len(quads.corners), QUADS_AT_ONCE)
        for block in [slice(start, start + QUADS_AT_ONCE)]
    ]
    facet, drawn = (np.concatenate(column) for column in zip(*blocks, strict=True))
    return facet, drawn


def ideal_leaves(mesh: PolygonMesh, limit: float, way: int) -> tuple[int, int]:
    """The number of leaves of an ideal quadtree, by facets (0) or as drawn (1), and its deepest level.

    Faces other than quads begin as their quarters.
    """
    leaves, level, deepest = 0, 0, 0
    frontier = [quads_of(mesh)]
    others = np.flatnonzero(mesh.face_sizes != 4)
    while frontier or level <= 1:
        if level == 1 and len(others):
            frontier.append(quarters_of(mesh, others))
        following = []
        for quads in frontier:
            if not len(quads.corners):
                continue
            deepest = level
            split = missed_by_all(mesh, quads)[way] > limit
            leaves += int(np.count_nonzero(~split))
            following.append(children(mesh, quads, split))
        frontier = [quads for quads in following if len(quads.corners)]
        level += 1
    return leaves, deepest


# What is made


@dataclass(frozen=True)
class Made:
    """An adaptive mesh: faces, -1 for too many; quads among them; leaves of the tree; the deepest level; seconds."""

    faces: int
    quads: int
    leaves: int
    deepest: int
    seconds: float


def make(mesh: PolygonMesh, limit: float, mode: Mode) -> Made:
    start = perf_counter()
    try:
        found = subdivide_adaptively(mesh, AdaptiveRequest(limit, mode, MOST_FACES), mesh.positions)
    except TooManyFacesError:
        return Made(-1, -1, -1, -1, perf_counter() - start)
    quads = int(np.count_nonzero(np.diff(found.mesh.face_starts) == 4))
    return Made(len(found.bounds), quads, found.leaf_count, int(found.depths.max()), perf_counter() - start)


HEADER = (
    f"{'':34}{'tolerance':>10}{'faces':>9}{'quads':>9}{'leaves':>9}{'ideal':>9}{'drawn':>9}"
    f"{'faces/ideal':>12}{'leaves/ideal':>13}{'leaves/drawn':>13}{'per face':>10}{'uniform':>15}"
)


def report(name: str, mesh: PolygonMesh, relative: float) -> bool:
    """Print a row; whether the lines hold."""
    limit = relative * float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))
    made, per_face = (make(mesh, limit, mode) for mode in (Mode.ADAPTIVE, Mode.PER_FACE))
    (ideal, _), (drawn, deepest) = (ideal_leaves(mesh, limit, way) for way in (0, 1))
    uniform = mesh.corner_count * 4 ** (deepest - 1) if deepest else mesh.face_count
    each = f"{per_face.faces:,}" if per_face.faces >= 0 else "too many"
    print(
        f"{name:34}{relative:10g}{made.faces:9,}{made.quads:9,}{made.leaves:9,}{ideal:9,}{drawn:9,}"
        f"{made.faces / ideal:12.2f}{made.leaves / ideal:13.2f}{made.leaves / drawn:13.2f}{each:>10}{uniform:15,}",
        flush=True,
    )
    holds = made.leaves <= MOST_OVER_IDEAL * ideal
    if name == "Suzanne after one step":
        holds &= made.faces <= LINES.get(relative, made.faces)
    return holds


# Meshes as they are modelled


def bevelled(*, as_cube: bool) -> meshes.MeshData:
    """A primitive with bevelled edges, after one step."""
    if as_cube:
        bpy.ops.mesh.primitive_cube_add()
    else:
        bpy.ops.mesh.primitive_cylinder_add(vertices=16)
    added = bpy.context.object
    bevel = added.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments, bevel.limit_method = 0.1, 2, "NONE" if as_cube else "ANGLE"
    scene.add_subdivision(added, 1)
    return scene.evaluated_mesh_data(added)


def planar_triangles(size: int = 16) -> meshes.MeshData:
    """The Delaunay triangles of a grid in one plane whose inner points are moved about."""
    generator = np.random.default_rng(0)
    places = np.stack(np.meshgrid(np.arange(size + 1.0), np.arange(size + 1.0), indexing="ij"), axis=-1).reshape(-1, 2)
    inside = np.all((places > 0) & (places < size), axis=1)
    places[inside] += generator.uniform(-0.3, 0.3, (np.count_nonzero(inside), 2))
    found = delaunay_2d_cdt([Vector(place) for place in places.tolist()], [], [], 0, 1e-9)
    positions, triangles = np.array([[*place, 0.0] for place in found[0]]), np.array(found[2])
    return meshes.MeshData(positions, np.full(len(triangles), 3), triangles.ravel())


def random_triangles(count: int) -> meshes.MeshData:
    """The Delaunay triangles of random points in a square, on waves."""
    points = np.random.default_rng(5).uniform(0, 1, (count, 2))
    found = delaunay_2d_cdt([Vector(point) for point in points.tolist()], [], [], 0, 1e-9)
    places, triangles = np.array([[*place] for place in found[0]]), np.array(found[2])
    heights = 0.05 * np.sin(6 * places[:, 0]) * np.cos(5 * places[:, 1])
    return meshes.MeshData(np.column_stack([places, heights]), np.full(len(triangles), 3), triangles.ravel())


def thin_triangles(count: int = 32) -> meshes.MeshData:
    """A fan of triangles over a quarter of a circle, bent."""
    angles = np.linspace(0, np.pi / 2, count + 1)
    rim = np.stack([np.cos(angles), np.sin(angles), 0.1 * np.cos(2 * angles)], axis=1)
    triangles = [[0, number + 1, number + 2] for number in range(count)]
    return meshes.MeshData(np.concatenate([np.zeros((1, 3)), rim]), np.full(count, 3), np.array(triangles).ravel())


def mechanical_part() -> meshes.MeshData:
    """A disc with an inset at both ends and bevelled edges, after one step."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=24, radius=1, depth=0.4)
    added, shape = bpy.context.object, bmesh.new()
    shape.from_mesh(added.data)
    bmesh.ops.inset_region(shape, faces=[face for face in shape.faces if len(face.verts) > 4], thickness=0.35)
    shape.to_mesh(added.data)
    shape.free()
    bevel = added.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments, bevel.limit_method = 0.05, 2, "ANGLE"
    scene.add_subdivision(added, 1)
    return scene.evaluated_mesh_data(added)


def suzanne_after(steps: int) -> meshes.MeshData:
    bpy.ops.mesh.primitive_monkey_add()
    scene.add_subdivision(bpy.context.object, steps)
    return scene.evaluated_mesh_data(bpy.context.object)


def blender_torus() -> meshes.MeshData:
    bpy.ops.mesh.primitive_torus_add(major_segments=12, minor_segments=8)
    return scene.evaluated_mesh_data(bpy.context.object)


MODELLED: dict[str, Callable[[], meshes.MeshData]] = {
    "bevelled cube": lambda: bevelled(as_cube=True),
    "bevelled cylinder": lambda: bevelled(as_cube=False),
    "Suzanne after one step": NAMED["Suzanne after one step"],
    "torus 12 x 8": blender_torus,
    "torus 16 x 12": lambda: meshes.torus(16, 12),
    "n-gons": NAMED["n-gons"],
    "planar triangles": planar_triangles,
    "random triangles, 500": lambda: random_triangles(500),
    "random triangles, 2,000": lambda: random_triangles(2_000),
    "random triangles, 16,000": lambda: random_triangles(16_000),
    "Suzanne after three steps": lambda: suzanne_after(3),
    "mechanical part": mechanical_part,
    "thin triangles": thin_triangles,
    "torus 24 x 12": lambda: meshes.torus(24, 12),
    "landscape": lambda: meshes.landscape(20, 20),
}

MODELLED_HEADER = (
    f"{'':34}{'tolerance':>10}{'faces':>9}{'before':>9}{'over':>7}{'seconds':>9}{'over':>7}"
    f"{'triangles':>10}{'reached':>9}{'proved':>9}"
)


@dataclass(frozen=True)
class Row:
    """A row: faces and seconds over those of the row before. holds: whether the row holds."""

    faces: float
    seconds: float
    holds: bool


def report_modelled(name: str, mesh: PolygonMesh, tolerance: float) -> Row:
    """Print a row."""
    limit = tolerance * float(np.linalg.norm(np.ptp(mesh.positions, axis=0))) if tolerance > 0 else -tolerance
    request = AdaptiveRequest(limit, Mode.ADAPTIVE, MOST_FACES)
    start = process_time()
    found = subdivide_adaptively(mesh, request, mesh.positions).mesh
    seconds = process_time() - start
    sizes = np.diff(found.face_starts)
    starts, vertices = found.face_starts[:-1, None], found.corner_vertices.astype(np.intp)
    first, second = starts + np.array([0, 1, 2]), starts[sizes == 4] + np.array([0, 2, 3])
    triangles = vertices[np.concatenate([first, second])]
    deviation = measure_deviation(mesh, found.positions, triangles, accuracy=ACCURACY, enough=limit)
    before, seconds_before = BEFORE[name][tolerance]
    row = Row(len(sizes) / before, seconds / seconds_before, False)
    print(
        f"{name:34}{tolerance:10g}{len(sizes):9,}{before:9,}{row.faces:7.2f}{seconds:9.2f}{row.seconds:7.1f}"
        f"{len(triangles):10,}{deviation.reached / limit:9.3f}{deviation.proved / limit:9.3f}",
        flush=True,
    )
    return replace(row, holds=row.faces <= MOST_OVER_BEFORE and deviation.proved <= limit)


def main(names: list[str]) -> int:
    """The exit status."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    print("ideal: quadtree by facets; drawn: quadtree by triangles; uniform: the level of its deepest leaf")
    print(HEADER)
    failed = []
    for name in [name for name in NAMED if not names or name in names]:
        data = meshes.single_precision(NAMED[name]())
        mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
        for relative in RELATIVE_TOLERANCES:
            if not report(name, mesh, relative):
                failed.append(f"{name} at {relative:g}")
        scene.clear()
    print(MODELLED_HEADER)
    rows = list[Row]()
    for name in [name for name in MODELLED if not names or name in names]:
        mesh = apply_boundary_rule(
            meshes.to_polygon_mesh(meshes.single_precision(MODELLED[name]())), smooth_corners=True
        )
        for tolerance in BEFORE[name]:
            rows.append(report_modelled(name, mesh, tolerance))
            if not rows[-1].holds:
                failed.append(f"{name}, modelled, at {tolerance:g}")
        scene.clear()
    if rows:
        faces, seconds = (np.exp(np.mean(np.log([getattr(row, of) for row in rows]))) for of in ("faces", "seconds"))
        print(f"Geometric means over before: {faces:.3f} of the faces, {seconds:.2f} of the seconds")
    print("Lines that do not hold: " + ("; ".join(failed) if failed else "none"))
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []))
