# SPDX-License-Identifier: GPL-3.0-or-later
"""Certified depths next to the least ones by brute force, with Blender's own Subdivision Surface as the measure.

python benchmarks/tightness.py -- [QUADS] [NAME…]            with the bpy wheel
blender -b --python benchmarks/tightness.py -- [QUADS] [NAME…]

Every level's facets are compared with the surface at the same parameters, some levels deeper. QUADS is the number of
quads of a deep level made for each mesh and level; if these do not suffice for all faces, only some faces are measured
at that level, in patches chosen at random. If all faces share a vertex of large valence, the surroundings of the vertex
need the most levels. Deep levels are then measured only near the vertex, in meshes cut out of Blender's level by level:
a distance there is reached on the whole face, so no least depth is overestimated. Exits with 1 if a depth is below the
least one, or fewer than 99.5 % of all are equal to it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.depth.face_depths import VERTICES, face_depths
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import scene
from tests.blender.measuring import BlenderLevels, part_of, rounding
from tests.blender.named_meshes import NAMED
from tests.brute_force import Comparison, Levels, compare

QUADS = 1_000_000
RELATIVE_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
LEAST_EQUAL_SHARE = 0.995

# Levels that are tried, and how much deeper the samples of each are.
DEEPER = (4, 4, 3, 3, 2, 2, 2, 2)

# Deep levels around a vertex that all the faces share: from this valence on, how many levels of facets are measured
# there, how much deeper the samples are, and the last level.
LARGE_VALENCE = 32
NEAR = 1
NEAR_DEEPER = 2
LAST_NEAR_LEVEL = 21

# Faces that lie together are measured together, as they need each other's surroundings; and as many as fit in a deep
# level of some quads at once.
PATCH_FACES = 16
QUADS_AT_ONCE = 400_000


@dataclass
class Measured:
    """(levels, F) distances of the faces at each level, nan if not measured.

    blender: by Blender's positions in single precision, uncertain by ``slack`` (levels,); core: by the core's positions
    in double precision, measured if a distance by Blender's is within the slack of a tolerance.
    """

    blender: FloatArray
    core: FloatArray
    slack: FloatArray

    @staticmethod
    def nothing(data: meshes.MeshData) -> Measured:
        count = len(data.face_sizes)
        levels = [level + deeper for level, deeper in enumerate(DEEPER)]
        if shared_vertex(data) is not None:
            levels += [level + NEAR_DEEPER for level in range(len(levels), LAST_NEAR_LEVEL + 1)]
        empty = np.full((len(levels), count), np.nan)
        # A distance has two ends, or three with limit vertices.
        return Measured(empty, empty.copy(), np.array([3 * rounding(data.positions, level) for level in levels]))

    def near(self, tolerances: list[float]) -> FloatArray:
        """(levels, F) bool: within the slack of a tolerance."""
        return np.any([np.abs(self.blender - tolerance) <= self.slack[:, None] for tolerance in tolerances], axis=0)

    def decided(self, tolerance: float) -> FloatArray:
        """(levels, F): the distances, in double precision where single precision does not decide."""
        return np.where(self.near([tolerance]), self.core, self.blender)


def shared_vertex(data: meshes.MeshData) -> int | None:
    """The vertex that all the faces share, if there is one of large valence."""
    found = np.flatnonzero(np.bincount(data.corner_vertices) == len(data.face_sizes))
    return int(found[0]) if len(found) == 1 and len(data.face_sizes) >= LARGE_VALENCE else None


def patches(data: meshes.MeshData, seed: int = 1) -> IndexArray:
    """All faces, ordered in patches of neighbouring faces, with the patches in random order."""
    middles = np.array([data.positions[face].mean(axis=0) for face in data.faces])
    left = np.random.default_rng(seed).permutation(len(middles))
    order = []
    while len(left):
        away = np.linalg.norm(middles[left] - middles[left[0]], axis=1)
        order.append(left[np.argsort(away, kind="stable")[:PATCH_FACES]])
        left = np.setdiff1d(left, order[-1], assume_unique=True)
        left = left[np.random.default_rng(len(order)).permutation(len(left))]
    return np.concatenate(order)


def blocks(data: meshes.MeshData, finest: int, quads: int) -> Iterator[tuple[meshes.MeshData, IndexArray, IndexArray]]:
    """Parts of the mesh to measure one by one: the part, its faces that count, and the same faces in the mesh."""
    order = patches(data)
    # About half of a part surrounds the other half; all of it if all faces touch.
    count = max(1, min(len(order), QUADS_AT_ONCE // (2 * 4**finest)))
    if shared_vertex(data) is not None:
        count = len(order)
    for start in range(0, len(order), count):
        faces = np.sort(order[start : start + count])
        part, numbers = part_of(data, faces)
        quads -= int(part.face_sizes.sum()) * 4 ** (finest - 1)
        if quads < 0:
            return
        yield part, np.searchsorted(numbers, faces), faces


def measure(data: meshes.MeshData, boundary: str, quads: int, tolerances: list[float]) -> dict[str, Measured]:
    """The measured distances by the name of the vertices, at every level of as many faces as the quads allow."""
    found = {vertices: Measured.nothing(data) for vertices in VERTICES}
    vertex = shared_vertex(data)
    # Around a large valence Blender takes very long for several levels at once: half a minute for four of valence 360.
    for level, deeper in enumerate(DEEPER if vertex is None else [NEAR_DEEPER + 1] * NEAR):
        for part, inside, faces in blocks(data, level + deeper, quads):
            own = BlenderLevels(part, boundary)
            core = Levels(own.subdivided(0))
            for vertices, measured in found.items():
                measured.blender[level, faces] = own.distances(level, vertices, deeper)[inside]
                if np.any(measured.near(tolerances)[level, faces]):
                    measured.core[level, faces] = core.distances(level, vertices, deeper)[inside]
            own.remove()
    if vertex is not None:
        measure_near(data, vertex, boundary, found, tolerances)
    return found


def measure_near(
    data: meshes.MeshData, vertex: int, boundary: str, found: dict[str, Measured], tolerances: list[float]
) -> None:
    """Measure the remaining levels near the vertex that all faces share, by the children of each face there."""
    faces = np.arange(len(data.face_sizes))
    own = BlenderLevels(data, boundary)
    core = own.subdivided(0)
    for level in range(NEAR, LAST_NEAR_LEVEL + 1):
        for vertices, measured in found.items():
            missing = np.isnan(measured.blender[level])
            if np.any(missing):
                distances = own.distances(NEAR, vertices, NEAR_DEEPER)[faces]
                measured.blender[level, missing] = distances[missing]
                near = missing & measured.near(tolerances)[level]
                if np.any(near):
                    measured.core[level, near] = Levels(core).distances(NEAR, vertices, NEAR_DEEPER + 1)[faces][near]
        children = np.flatnonzero(core.corner_vertices[: core.face_starts[len(faces)]] == vertex)
        # Children come in the order of the corners, and vertex points first.
        part = submesh(own.mesh(1), children)[0]
        core = submesh(subdivide(core), children)[0]
        own.remove()
        vertex = int(part.corner_vertices[0])
        quads = part.corner_vertices.reshape(-1, 4).tolist()
        own = BlenderLevels(meshes.from_faces(part.positions, quads), boundary)
    own.remove()


def compare_mesh(
    data: meshes.MeshData, boundary: str, quads: int, relative_tolerances: tuple[float, ...]
) -> tuple[dict[float, Comparison], float, int]:
    """The counts by relative tolerance, for both kinds of vertices together; the largest difference between Blender and
    the core in units of the slack; and the number of distances decided only in double precision."""
    data = meshes.single_precision(data)
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=boundary == "ALL")
    diagonal = float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))
    measured = measure(data, boundary, quads, [relative * diagonal for relative in relative_tolerances])
    totals = {}
    for relative in relative_tolerances:
        totals[relative] = Comparison()
        for vertices in VERTICES:
            found = face_depths(mesh, relative * diagonal, "CERTIFIED", vertices)
            sampled = measured[vertices].decided(relative * diagonal)
            totals[relative] += compare(mesh, sampled, found, relative * diagonal, vertices)
    apart = [np.abs(each.blender - each.core) / each.slack[:, None] for each in measured.values()]
    near = sum(
        np.count_nonzero(each.near([relative * diagonal]))
        for each in measured.values()
        for relative in relative_tolerances
    )
    return totals, float(np.nanmax(apart)) if np.isfinite(apart).any() else 0.0, near


HEADER = (
    f"{'':44}{'compared':>9}{'equal':>8}{'closely':>8}{'1 above':>8}{'more':>6}{'below':>6}"
    f"{'inexact':>8}{'wrong':>6}{'unknown':>8}"
)


def row(name: str, found: Comparison) -> str:
    return (
        f"{name:44}{found.faces:9,}{found.equal:8,}{found.confirmed:8,}{found.one_above:8,}{found.more_above:6,}"
        f"{found.below:6,}{found.unproved:8,}{found.wrongly_exact:6,}{found.unknown:8,}"
    )


def main(quads: int = QUADS, names: Sequence[str] = ()) -> int:
    """The exit status."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    print(f"Blender {bpy.app.version_string}; both kinds of vertices together; depths compared with the least ones")
    print(
        "closely: equal once the largest distance had been looked for more closely; inexact: not said to be the least;"
        "\nwrong: said to be the least, and not by the samples; unknown: too deep to measure"
    )
    print(HEADER)
    total = Comparison()
    by_tolerance = {relative: Comparison() for relative in RELATIVE_TOLERANCES}
    for name in names or list(NAMED):
        start = perf_counter()
        data = NAMED[name]()
        found, apart, near = compare_mesh(data, "ALL", quads, RELATIVE_TOLERANCES)
        whole = Comparison()
        for relative, comparison in found.items():
            whole += comparison
            by_tolerance[relative] += comparison
        total += whole
        print(row(f"{name}, {len(data.face_sizes):,} faces", whole), end="   ")
        print(f"{perf_counter() - start:4.0f} s; {near} in double precision, {apart:.2f} slacks apart", flush=True)
        scene.clear()
    for relative, comparison in by_tolerance.items():
        print(row(f"tolerance {relative:g} of the diagonal", comparison))
    print(row("in total", total))
    print(f"equal on {100 * total.equal_share:.3f} %, below on {total.below}")
    return int(total.below > 0 or total.equal_share < LEAST_EQUAL_SHARE)


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    sys.exit(main(int(given[0]) if given else QUADS, given[1:]))
