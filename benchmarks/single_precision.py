# SPDX-License-Identifier: GPL-3.0-or-later
"""The error of the Subdivision Surface modifier's vertices in Blender's single precision, as a part of the law.

python benchmarks/single_precision.py -- [TRIPLES [SIZE…]]        with the bpy wheel

SIZE: valences and numbers of corners; TRIPLES: the number of offsets of all three coordinates at each. Vertices lie on
a grid of 2⁻¹², and so do offsets below 2¹¹: single precision holds their sums, so that a level is computed in double
precision once for all offsets. The coordinates are rounded apart: each is a case of its own. Prints the largest ratio
of each shape and size at each level, with Use Limit Surface off and on. Exits with 1 where one is more than two thirds.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from mathutils.kdtree import KDTree

from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.bounds.rounding import modifier_rounding
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import scene
from tests.brute_force import Levels

GRID, LEAST_EXPONENT, LARGEST_EXPONENT = 2.0**-12, -3, 10
SIZES = (3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 24, 32, 48, 64, 96, 128, 192, 256)
TRIPLES = 20
MOST = 2 / 3

# Poles of quads and of triangles, n-gons among quads, poles of n-gons, and n-gons around one.
SHAPES: dict[str, Callable[[int], meshes.MeshData]] = {
    "fan": lambda size: meshes.fan(size, 1),
    "bipyramid": lambda sides: meshes.sphere(sides, 2),
    "prism": meshes.cylinder,
    "wheel": lambda size: wheel(size, 8),
    "wheel of 32-gons": lambda size: wheel(min(size, 32), 32),
    "hexagons": lambda size: meshes.hexagons(min(size, 8), 3, 0.2),
    "landscape": lambda size: meshes.landscape(min(size, 8), 4),
}


def wheel(valence: int, size: int) -> meshes.MeshData:
    """Polygons with ``size`` > 3 corners around vertex 0."""
    count = valence * (size - 2)
    angles = 2 * np.pi * np.arange(count) / count
    rim = np.stack([np.cos(angles), np.sin(angles), 0.1 * np.cos(3 * angles)], axis=1)
    faces = [[0, *(1 + (np.arange(first, first + size - 1) % count)).tolist()] for first in range(0, count, size - 2)]
    return meshes.from_faces([[0.0, 0.0, 0.3], *rim.tolist()], faces)


# The last level up to the largest surroundings.
LAST_LEVELS = {24: 6, 100: 4, 400: 3, 1 << 20: 2}


def ratios(data: meshes.MeshData, level: int, offsets: FloatArray) -> dict[bool, float]:
    """The largest errors of a coordinate, with Use Limit Surface off and on, at a level of the mesh moved by each of
    the offsets (N, 3), as parts of ``modifier_rounding`` for a mesh of the same size along that axis."""
    data = replace(data, positions=np.rint(data.positions / GRID) * GRID)
    control = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=False)
    exact = Levels(control).mesh(level)
    one = control.changed(positions=np.zeros_like(control.positions), rounded_size=1.0)
    part = scene.add_object(data)
    modifier = scene.add_subdivision(part, level, "PRESERVE_CORNERS")
    modifier.quality = level
    order = nearest_points(exact.positions, scene.evaluated_mesh_data(part).positions)
    found = {}
    for modifier.use_limit_surface in (False, True):
        points = (limit_positions(exact) if modifier.use_limit_surface else exact.positions)[order]
        largest = 0.0
        for offset in offsets:
            moved = data.positions + offset
            part.data.attributes["position"].data.foreach_set("vector", moved.astype(np.float32).ravel())
            part.data.update()
            off = np.abs(scene.evaluated_mesh_data(part).positions - offset - points).max(axis=0)
            largest = max(largest, float((off / np.abs(moved).max(axis=0)).max()) / modifier_rounding(one, level))
        found[modifier.use_limit_surface] = largest
    bpy.data.meshes.remove(part.data)
    return found


def nearest_points(points: FloatArray, queries: FloatArray) -> IndexArray:
    """(Q,): the point nearest to each of the queries (Q, 3). Raises ValueError unless each query has a point of its
    own."""
    tree = KDTree(len(points))
    for index, point in enumerate(points):
        tree.insert(point, index)
    tree.balance()
    nearest = np.array([tree.find(query)[1] for query in queries])
    if len(np.unique(nearest)) < len(points):
        raise ValueError("vertices are too near to each other to be told apart")
    return nearest


def random_offsets(count: int, seed: int) -> FloatArray:
    """(count, 3) on the grid, of all sizes and both signs."""
    random = np.random.default_rng(seed)
    sizes = 2.0 ** random.uniform(LEAST_EXPONENT, LARGEST_EXPONENT, (count, 3))
    return np.rint(sizes / GRID) * GRID * random.choice([-1, 1], (count, 3))


def main() -> int:
    arguments = [int(text) for text in sys.argv[sys.argv.index("--") + 1 :]] if "--" in sys.argv else []
    triples, sizes = (arguments[0] if arguments else TRIPLES), arguments[1:] or SIZES
    print(f"{'shape':>20} {'size':>5}   each level, off / on")
    worst = 0.0
    for (name, make), size in product(SHAPES.items(), sizes):
        data = make(size)
        last = next(level for most, level in LAST_LEVELS.items() if surroundings(data) <= most)
        found = [ratios(data, level, random_offsets(triples, level)) for level in range(1, last + 1)]
        worst = max(worst, *(ratio for both in found for ratio in both.values()))
        levels = "  ".join(f"{both[False]:.2f} / {both[True]:.2f}" for both in found)
        print(f"{name:>20} {size:5}  ", levels, flush=True)
    print(f"The largest ratio is {worst:.3f}")
    return int(worst > MOST)


def surroundings(data: meshes.MeshData) -> int:
    return meshes.to_polygon_mesh(data).largest_surroundings


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    # The bpy module can hang while the interpreter winds up.
    os._exit(status)
