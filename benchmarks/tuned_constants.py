# SPDX-License-Identifier: GPL-3.0-or-later
"""The gain of each cache, store, fast path and tuned constant: all are switched off in turn.

python benchmarks/tuned_constants.py [--repeat N] [--results FILE] [PART OF A NAME…]        with the bpy wheel

Prints a Markdown table: time, memory and faces without the thing, as ratios to those with it, the largest over its
workloads. Every run is a process of its own, with one thread except for things about threads, and runs with and without
a thing take turns, so that a busy machine slows both. Ratios of memory and faces are of medians; ratios of time are of
the least times, as other programs only add time. Time is processor time, user and system, of all threads; for things
about threads it is time by the clock, which depends on the number of processors. Memory is the largest memory of the
process during the work above that before (known on Linux alone). Faces are the faces of the adaptive mesh, or the faces
by depths; for a deviation, the proved distance. The gain of a cache is counted, not timed: the number of its hits,
times the time to compute an entry.

Measurements are appended to FILE, and count together with those in it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from statistics import median
from time import perf_counter, thread_time
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

PACKAGE = "ccdepth_addon"
# The figures of a run, by name: "time", "clock", "memory" and "faces".
Figures = dict[str, float]

# Runs with and without an entry, by its name and a workload.
Found = dict[tuple[str, str], list[tuple[Figures, Figures]]]

UNLIMITED = 1 << 40
NEVER, ALWAYS = 0.0, float("inf")

# Workloads that work with Blender.
IN_BLENDER = {
    *("writing", "reduced", "reduced, uneven", "frames", "staleness"),
    *("computed", "objects", "objects with modifiers"),
}

# The number of things switched off between two runs with everything on.
RUNS_BETWEEN = 3

# A ratio nearer to 1 than this is not told from it, and is printed without its workload.
NOISE = 0.05


# Workloads: each makes its input, imports what it uses, and returns the work, which returns its result.


def noisy_grid(side: int, insets: int = 0) -> Any:
    from benchmarks.hills import hills
    from tests.meshes import MeshData

    positions, quads = hills(side, insets)
    noise = np.random.default_rng(2).normal(0.0, 0.003, positions.shape)
    return control_of(MeshData(positions + noise, np.full(len(quads), 4), quads.ravel()))


def control_of(data: Any) -> Any:
    from ccdepth_addon.core import apply_boundary_rule
    from tests import meshes

    return apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)


def saved_suzanne() -> Any:
    """The control mesh that ``save_suzanne`` has put into the directory for inputs."""
    from tests.meshes import MeshData

    with np.load(os.environ["CCDEPTH_INPUTS"] + "/suzanne.npz") as saved:
        return control_of(MeshData(saved["positions"], saved["face_sizes"], saved["corner_vertices"]))


def save_suzanne(directory: str) -> None:
    from tests.blender import scene

    data = scene.suzanne()
    np.savez(
        directory + "/suzanne.npz",
        positions=data.positions,
        face_sizes=data.face_sizes,
        corner_vertices=data.corner_vertices,
    )


def refined(mesh: Any, steps: int) -> Any:
    from ccdepth_addon.core.surface.catmull_clark import subdivide

    for _ in range(steps):
        mesh = subdivide(mesh)
    return mesh


def creased_landscape(side: int, share: float = 0.1) -> Any:
    from tests import meshes

    return control_of(meshes.with_random_creases(meshes.landscape(side, side), share=share))


def triangulated(side: int) -> Any:
    """A landscape of triangles, each quad of a grid cut along one diagonal or the other."""
    from tests import meshes

    quads = meshes.landscape(side, side)
    corners = quads.corner_vertices.reshape(-1, 4)
    turned = np.random.default_rng(3).integers(0, 2, len(corners))
    corners = np.take_along_axis(corners, (np.arange(4) + turned[:, None]) % 4, axis=1)
    triangles = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1)
    return control_of(meshes.MeshData(quads.positions, np.full(2 * len(corners), 3), triangles))


def bricks(side: int) -> Any:
    """A bumpy wall of hexagons."""
    from tests import meshes

    columns = 2 * side + 2
    places = np.arange(columns * (side + 1))
    across, along = np.divmod(places, columns)
    rng = np.random.default_rng(4)
    positions = np.stack([along, across, rng.normal(0.0, 0.3, len(places))], axis=1).astype(np.float64)
    first = np.concatenate([columns * row + row % 2 + 2 * np.arange(side) for row in range(side)])
    faces = first[:, None] + np.array([0, 1, 2, columns + 2, columns + 1, columns])
    return control_of(meshes.MeshData(positions, np.full(len(faces), 6), faces.ravel()))


def pole(valence: int, rings: int) -> Any:
    from tests import meshes

    return control_of(meshes.fan(valence, rings))


def poles(valence: int, count: int) -> Any:
    """Several, one above another."""
    from tests import meshes

    one = meshes.fan(valence, 1)
    return control_of(
        meshes.MeshData(
            np.concatenate([one.positions + np.array([0.0, 0.0, 0.1 * number]) for number in range(count)]),
            np.tile(one.face_sizes, count),
            np.concatenate([one.corner_vertices + len(one.positions) * number for number in range(count)]),
        )
    )


def trapezohedron(sides: int) -> Any:
    """Two poles with faces that touch vertices of valence 3."""
    from tests import meshes

    return control_of(meshes.bumpy(meshes.trapezohedron(sides), 0.05))


def dart(valence: int) -> Any:
    """A pole with the end of a crease."""
    from tests import meshes

    fan = meshes.fan(valence, 2)
    first, second = next(edge for edge in fan.edges.tolist() if 0 in edge)
    return control_of(meshes.creased(fan, {(first, second): 1.0}))


def planar() -> Any:
    """Triangles in one plane."""
    from benchmarks.adaptive_faces import planar_triangles

    return control_of(planar_triangles())


def parabola(side: int) -> Any:
    """A grid over z = x²; each control facet is 1/3 from the surface along a line."""
    from tests import meshes

    grid = meshes.grid(side, side)
    x, y, _ = grid.positions.T
    return control_of(meshes.MeshData(np.stack([x, y, x**2], axis=1), grid.face_sizes, grid.corner_vertices))


def depths(make: Callable[[], Any], method: str, vertices: str, tolerance: float) -> Callable[[], Any]:
    """Depths of the faces; the result is the number of faces by these depths."""
    from ccdepth_addon.core import face_depths

    mesh = make()
    limit = tolerance * diagonal(mesh)
    return lambda: float((4.0 ** face_depths(mesh, limit, method, vertices).depths).sum())


def small_depths(count: int) -> Callable[[], Any]:
    """Depths of many small meshes, one after another."""
    from ccdepth_addon.core import face_depths

    sources = [creased_landscape(3, 0.3), pole(5, 2), triangulated(2), noisy_grid(4)]

    def work() -> float:
        faces = 0.0
        for number in range(count):
            mesh = sources[number % len(sources)]
            mesh = mesh.changed(positions=mesh.positions.copy())
            found = face_depths(mesh, 1e-2 * diagonal(mesh), "CERTIFIED", "CONTROL")
            faces += float((4.0**found.depths).sum())
        return faces

    return work


def bounds_at(make: Callable[[], Any], tolerance: float, level: int) -> Callable[[], Any]:
    """The proved distances of all faces at one level; the result is the number within the tolerance."""
    from tests.proved_bounds import level_bounds

    mesh = make()
    limit = tolerance * diagonal(mesh)
    return lambda: float(np.isfinite(level_bounds(mesh, limit, "CERTIFIED", "CONTROL", level)).sum()) + 1


def level(make: Callable[[], Any], tolerance: float) -> Callable[[], Any]:
    """The first level that holds for all faces."""
    from ccdepth_addon.core.depth.face_depths import uniform_level

    mesh = make()
    limit = tolerance * diagonal(mesh)
    return lambda: float(4.0 ** uniform_level(mesh, limit, "CERTIFIED", "LIMIT"))


def bending(mesh: Any, count: int) -> list[Any]:
    """Poses that bend more and more, by 70° at most."""
    from ccdepth_addon.core import Pose

    heights = mesh.positions[:, 2]
    low, high = heights.min(), heights.max()
    bent = (heights - low) / (high - low)
    axis, sides = mesh.positions[:, 0], mesh.positions[:, [1, 2]]

    def pose(number: int) -> Any:
        angles = 1.2 * number / count * bent
        cosines, sines = np.cos(angles), np.sin(angles)
        turned = [cosines * sides[:, 0] - sines * sides[:, 1], sines * sides[:, 0] + cosines * sides[:, 1]]
        return mesh.changed(positions=np.stack([axis, *turned], axis=1))

    tolerance = diagonal(mesh)
    return [Pose(partial(pose, number), tolerance) for number in range(count)]


def posed(make: Callable[[], list[Any]], tolerance: float = 1e-3) -> Callable[[], Any]:
    """Depths over several poses; the result is the number of faces by these depths."""
    from ccdepth_addon.core import pose_depths

    poses = within(make(), tolerance)
    return lambda: float((4.0 ** pose_depths(poses, "CERTIFIED", "CONTROL").depths).sum())


def within(poses: list[Any], tolerance: float) -> list[Any]:
    """The same poses with fractions of their tolerances."""
    return [replace(pose, tolerance=tolerance * pose.tolerance) for pose in poses]


def diagonal(mesh: Any) -> float:
    return float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))


def adaptive_mesh(mesh: Any, tolerance: float, most_faces: int = 10_000_000) -> Any:
    from ccdepth_addon.core import AdaptiveRequest, Mode, subdivide_adaptively

    request = AdaptiveRequest(tolerance * diagonal(mesh), Mode.ADAPTIVE, most_faces)
    return subdivide_adaptively(mesh, request, mesh.positions)


def adaptive(make: Callable[[], Any], tolerance: float) -> Callable[[], Any]:
    """An adaptive mesh; the result is the number of its faces."""
    import ccdepth_addon.core  # noqa: F401

    mesh = make()
    return lambda: float(len(adaptive_mesh(mesh, tolerance).bounds))


def small_adaptive(count: int) -> Callable[[], Any]:
    """Adaptive meshes of many small ones, one after another."""
    import ccdepth_addon.core  # noqa: F401

    sources = [creased_landscape(2, 0.3), pole(5, 1), triangulated(1), noisy_grid(3)]
    return lambda: sum(float(len(adaptive_mesh(sources[n % len(sources)], 2e-2).bounds)) for n in range(count))


def refused(make: Callable[[], Any], tolerance: float, most_faces: int) -> Callable[[], Any]:
    """An adaptive mesh that is refused for its size."""
    from ccdepth_addon.core import TooManyFacesError

    mesh = make()

    def work() -> float:
        try:
            adaptive_mesh(mesh, tolerance, most_faces)
        except TooManyFacesError:
            return 1.0
        raise AssertionError("not refused")

    return work


def deviation(make: Callable[[], Any], steps: int, moved: float = 0.0) -> Callable[[], Any]:
    """The deviation of a subdivided mesh, moved by a distance; the result is the proved distance."""
    from ccdepth_addon.core import measure_deviation

    control = make()
    shown = refined(control, steps)
    quads = shown.corner_vertices.reshape(-1, 4)
    triangles = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.intp)
    positions = shown.positions + moved * np.array([0.6, 0.64, 0.48])
    return lambda: measure_deviation(control, positions, triangles, time_limit=600.0).proved


def written(tolerance: float) -> Callable[[], Any]:
    """An adaptive Suzanne as a Blender mesh: UV maps with seams, colours, weights, exact normals."""
    import bpy

    import ccdepth_addon
    from ccdepth_addon.core import apply_boundary_rule
    from ccdepth_addon.exchange.adaptive_mesh import new_mesh
    from tests.blender import scene

    ccdepth_addon.register()
    scene.clear()
    base = scene.add_suzanne()
    scene.add_subdivision(base, 1)
    shown = base.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(shown)
    rng = np.random.default_rng(5)
    for name, kind, domain in (("Colour", "FLOAT_COLOR", "POINT"), ("Wear", "FLOAT", "CORNER")):
        data = mesh.attributes.new(name, kind, domain).data
        field, width = ("color", 4) if kind == "FLOAT_COLOR" else ("value", 1)
        data.foreach_set(field, rng.random(width * len(data)).astype(np.float32))
    control = apply_boundary_rule(scene.polygon_mesh_of(mesh), smooth_corners=True)
    found = adaptive_mesh(control, tolerance)

    def work() -> float:
        made = new_mesh(mesh, control, found.mesh, exact_normals=True)
        return float(len(made.polygons))

    return work


def reduced(name: str, tolerance: float) -> Callable[[], Any]:
    """A reduced adaptive mesh; the result is the number of its triangles."""
    import bpy

    import ccdepth_addon
    from benchmarks import reduce
    from tests.blender import scene

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    ccdepth_addon.register()
    scene.clear()
    added = reduce.CASES[name]()
    bpy.context.view_layer.objects.active = added
    added.select_set(True)

    def work() -> float:
        bpy.ops.ccdepth.subdivide(tolerance=tolerance, tolerance_mode="RELATIVE", reduce=True)
        return float(len(bpy.context.selected_objects[0].data.polygons))

    return work


def frames(count: int) -> Callable[[], Any]:
    """Compute Depth over frames with a shape key."""
    import bpy

    import ccdepth_addon
    from benchmarks.frames import TOLERANCES, deformed
    from tests.blender import addon

    ccdepth_addon.register()
    holder = deformed(2)
    addon.select(holder)

    def work() -> float:
        bpy.ops.ccdepth.compute(
            tolerance=TOLERANCES[2],
            tolerance_mode="RELATIVE",
            method="CERTIFIED",
            vertices="CONTROL",
            frames="CUSTOM",
            frame_list=f"1-{count}",
        )
        return float(holder.data.ccdepth.deepest) + 1

    return work


def operators(count: int, *, with_modifiers: bool) -> Callable[[], Any]:
    """Compute Depth on many objects that share a mesh, and then the test whether the depths are stale; at their own
    scales, or each with a Mirror modifier by another, large object."""
    import bpy

    import ccdepth_addon
    from benchmarks.compute_depth import add_grid

    ccdepth_addon.register()
    from ccdepth_addon.state import still_holds

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    mirror, shared = add_grid(300, 0), add_grid(24, 0).data
    objects = [bpy.data.objects.new("User", shared) for _ in range(count)]
    bpy.ops.object.select_all(action="DESELECT")
    for number, each in enumerate(objects):
        bpy.context.scene.collection.objects.link(each)
        each.select_set(True)
        each.scale = (1 + number % 2, 1.0, 1.0)
        if with_modifiers:
            each.modifiers.new("Mirror", "MIRROR").mirror_object = mirror
    bpy.context.view_layer.objects.active = objects[0]
    bpy.context.view_layer.update()

    def work() -> float:
        bpy.ops.ccdepth.compute(method="SECOND_ORDER")
        still_holds.examine(shared, objects, {})
        return float(shared.ccdepth.deepest)

    return work


def computed(side: int) -> Callable[[], Any]:
    """Compute Depth on a grid of regular faces, from the button to the attributes."""
    import bpy

    import ccdepth_addon
    from benchmarks import compute_depth

    ccdepth_addon.register()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    grid = compute_depth.add_grid(side, 0)

    def work() -> float:
        compute_depth.compute_depth("CERTIFIED", "CONTROL", compute_depth.RELATIVE_TOLERANCE)
        return float(grid.data.ccdepth.deepest)

    return work


def staleness(count: int) -> Callable[[], Any]:
    """The test whether depths are stale, for many objects with a group of geometry nodes each."""
    import bpy

    import ccdepth_addon
    from benchmarks.compute_depth import add_grid

    ccdepth_addon.register()
    from ccdepth_addon.state import still_holds

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    first = add_grid(4, 0)
    users = [first, *(bpy.data.objects.new("User", first.data) for _ in range(count))]
    for user in users:
        tree: Any = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
        for direction in ("INPUT", "OUTPUT"):
            tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
        given, made = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
        tree.links.new(given.outputs[0], made.inputs[0])
        for _ in range(20):
            tree.nodes.new("ShaderNodeMath")
        user.modifiers.new("Nodes", "NODES").node_group = tree
    bpy.ops.ccdepth.compute(method="SECOND_ORDER")

    def work() -> float:
        for _ in range(10):
            still_holds.examine(first.data, users, {})
        return 1.0

    return work


WORKLOADS: dict[str, Callable[[], Callable[[], Any]]] = {
    "depths": lambda: depths(lambda: noisy_grid(400), "CERTIFIED", "CONTROL", 3e-5),
    "threads": lambda: depths(lambda: noisy_grid(700), "CERTIFIED", "CONTROL", 3e-5),
    "threads, small": lambda: small_depths(30),
    "depths, limit": lambda: depths(lambda: noisy_grid(200), "CERTIFIED", "LIMIT", 3e-5),
    "depths, extraordinary": lambda: depths(lambda: noisy_grid(120, 600), "CERTIFIED", "CONTROL", 1e-4),
    "depths, creases": lambda: depths(lambda: creased_landscape(24), "CERTIFIED", "CONTROL", 1e-3),
    "depths, pole": lambda: depths(lambda: pole(256, 2), "CERTIFIED", "CONTROL", 1e-4),
    "depths, large": lambda: depths(lambda: noisy_grid(700, 8000), "CERTIFIED", "CONTROL", 1e-3),
    "depths, trapezohedron": lambda: depths(lambda: trapezohedron(40), "CERTIFIED", "CONTROL", 1e-4),
    "depths, dart": lambda: depths(lambda: dart(64), "CERTIFIED", "CONTROL", 1e-3),
    "depths, undecidable": lambda: depths(lambda: parabola(40), "CERTIFIED", "CONTROL", 1 / 3 / diagonal(parabola(40))),
    "depths by norms, poles": lambda: depths(lambda: poles(200, 20), "SECOND_ORDER", "CONTROL", 1e-3),
    "depths by norms": lambda: depths(lambda: noisy_grid(250, 3000), "SECOND_ORDER", "CONTROL", 1e-4),
    "depths by norms, creases": lambda: depths(lambda: creased_landscape(60), "SHARP", "CONTROL", 1e-4),
    "small depths": lambda: small_depths(30),
    "poses": lambda: posed(lambda: bending(refined(saved_suzanne(), 1), 64)),
    "poses, large": lambda: posed(lambda: bending(noisy_grid(150), 33), 1e-4),
    "deep level": lambda: bounds_at(lambda: noisy_grid(60, 100), 1e-5, 8),
    "level": lambda: level(lambda: creased_landscape(16), 1e-3),
    "adaptive": lambda: adaptive(lambda: refined(saved_suzanne(), 2), 8e-5),
    "adaptive, large": lambda: adaptive(lambda: refined(saved_suzanne(), 3), 3e-5),
    "adaptive, coarse": lambda: adaptive(lambda: refined(saved_suzanne(), 1), 3e-4),
    "adaptive, creases": lambda: adaptive(lambda: creased_landscape(7), 3e-4),
    "adaptive, triangles": lambda: adaptive(lambda: triangulated(6), 1e-3),
    "adaptive, n-gons": lambda: adaptive(lambda: bricks(10), 1e-3),
    "adaptive, pole": lambda: adaptive(lambda: pole(64, 2), 3e-4),
    "adaptive, large pole": lambda: adaptive(lambda: pole(120, 1), 1e-3),
    "adaptive, planar": lambda: adaptive(planar, 2e-3),
    "adaptive, small": lambda: small_adaptive(20),
    "adaptive, coarse triangles": lambda: adaptive(lambda: triangulated(6), 6e-3),
    "adaptive, refused": lambda: refused(lambda: refined(saved_suzanne(), 3), 1e-7, 1_000_000),
    "deviation": lambda: deviation(saved_suzanne, 2),
    "deviation, creases": lambda: deviation(lambda: creased_landscape(12), 2),
    "deviation, large": lambda: deviation(saved_suzanne, 4),
    "deviation, moved": lambda: deviation(saved_suzanne, 1, 0.05),
    "deviation, far": lambda: deviation(saved_suzanne, 1, 1.0),
    "deviation, planar": lambda: deviation(planar, 1),
    "writing": lambda: written(5e-5),
    "reduced": lambda: reduced("bevelled cube, UV map", 1e-3),
    "reduced, uneven": lambda: reduced("torus", 3e-3),
    "frames": lambda: frames(20),
    "staleness": lambda: staleness(60),
    "computed": lambda: computed(500),
    "objects": lambda: operators(300, with_modifiers=False),
    "objects with modifiers": lambda: operators(200, with_modifiers=True),
}


# Switches


def located(place: str) -> tuple[Any, str]:
    """The module or class of a thing in the package, and its name there."""
    names = place.split(".")
    for end in range(len(names) - 1, -1, -1):
        try:
            owner = importlib.import_module(".".join([PACKAGE, *names[:end]]))
        except ModuleNotFoundError:
            continue
        for name in names[end:-1]:
            owner = getattr(owner, name)
        return owner, names[-1]
    raise LookupError(place)


def replace_with(place: str, new: Any) -> None:
    """Replace a thing, also in modules that have imported it by its name, and in default arguments."""
    owner, name = located(place)
    old = getattr(owner, name)
    setattr(owner, name, new)
    for module in [module for key, module in sys.modules.items() if key.startswith(PACKAGE)]:
        if vars(module).get(name) is old:
            setattr(module, name, new)
        for function in vars(module).values():
            # Small numbers are the same object wherever they stand.
            if (defaults := getattr(function, "__defaults__", None)) and isinstance(old, int) and old > 1 << 8:
                function.__defaults__ = tuple(new if default is old else default for default in defaults)


def set_to(value: Any) -> Callable[[str], None]:
    return lambda place: replace_with(place, value)


def count_anew(place: str) -> dict[str, float]:
    """Add up the seconds to compute each hit of ``cache``, ``lru_cache`` or ``cached_property`` anew: "anew"; and the
    seconds of counting: "counting". The cost of a function is that of its second call with the same arguments, with
    filled caches below it."""
    owner, name = located(place)
    cached, seconds = vars(owner)[name], {"anew": 0.0, "counting": 0.0}
    known: dict[Any, tuple[Any, float]] = {}

    def called(*given: Any, **named: Any) -> Any:
        key = (given, tuple(named.items()))
        if key in known:
            seconds["anew"] += known[key][1]
        else:
            value = cached.__wrapped__(*given, **named)
            start = thread_time()
            cached.__wrapped__(*given, **named)
            known[key] = value, thread_time() - start
            seconds["counting"] += known[key][1]
        return known[key][0]

    def read(holder: Any) -> Any:
        kept, cost = vars(holder), f"seconds of {name}"
        is_first = name not in kept
        if cost not in kept:
            start = thread_time()
            kept[name] = cached.func(holder)
            kept[cost] = thread_time() - start
            seconds["counting"] += 0.0 if is_first else kept[cost]
        seconds["anew"] += 0.0 if is_first else kept[cost]
        return kept[name]

    if isinstance(cached, cached_property):
        setattr(owner, name, property(read))
    else:
        replace_with(place, called)
    return seconds


def by(make: Callable[[Any], Any]) -> Callable[[str], None]:
    """Replace a function by another made from it."""

    def switch(place: str) -> None:
        owner, name = located(place)
        replace_with(place, make(vars(owner)[name]))

    return switch


def numpy_product(_: Any) -> Any:
    return lambda matrix, columns: matrix @ columns


def numpy_cross(_: Any) -> Any:
    return np.cross


def numpy_norms(_: Any) -> Any:
    return lambda vectors: np.einsum("...i,...i->...", vectors, vectors)


def numpy_dots(_: Any) -> Any:
    return lambda a, b: np.einsum("...i,...i->...", a, b)


def as_it_is(_: Any) -> Any:
    return lambda vectors: vectors


def row_major(_: Any) -> Any:
    return np.ascontiguousarray


def summed_one_by_one(_: Any) -> Any:
    def sums(indices: Any, vectors: Any, count: int) -> Any:
        total = np.zeros((count, vectors.shape[1]))
        np.add.at(total, indices, vectors)
        return total

    return sums


def one_thread(_: Any = None) -> Any:
    """Threads that wait for each other take processor time by chance."""
    replace_with("core.arrays.threads._thread_count", lambda: 1)
    return lambda: 1


def a_pool_each(_: Any) -> Any:
    """New threads for each call of ``map_in_threads``, which asks for them at every task."""
    threads: Any = importlib.import_module(PACKAGE + ".core.arrays.threads")
    mapped = threads.map_in_threads
    pools: list[ThreadPoolExecutor] = []

    def mapped_anew(*given: Any) -> Any:
        pools.append(ThreadPoolExecutor(threads._thread_count()))
        yield from mapped(*given)
        pools.pop().shutdown()

    replace_with("core.arrays.threads.map_in_threads", mapped_anew)
    return lambda: pools[-1]


def no_topology(changed: Any) -> Any:
    return lambda mesh, **fields: replace(mesh, **fields)


def nothing(_: Any) -> Any:
    return lambda *_args, **_named: None


def forgotten_limits(limits: Any) -> Any:
    return property(lambda refinement: limits.fget(replace(refinement, limits=None)))


def no_norms(rough_bounds: Any) -> Any:
    """Bounds by the norm alone that are useless."""

    def unknown(patches: Any, vertices: Any) -> Any:
        found = rough_bounds(patches, vertices)
        patches.rough = replace(found, value=np.full_like(found.value, np.inf))
        return patches.rough

    return unknown


def evaluated_everywhere(_: Any) -> Any:
    """Values at all corners, evaluated for each corner on its own."""
    return lambda subdivided, evaluate: np.asarray(evaluate(subdivided.corner_points), dtype=np.float32)


def made_anew(cached: Any) -> Any:
    """A property that is not kept."""
    return property(cached.func)


def not_known(function: Any) -> Any:
    """Descriptions made without those of other objects at the same time."""
    return lambda *given, known=None, **named: function(*given, known=None, **named)


def not_shared(function: Any) -> Any:
    return lambda *given, shared=None, **named: function(*given, shared=None, **named)


@dataclass(frozen=True)
class Entry:
    """A thing to switch off. place: its place in the package; off: the meaning of switching it off; workloads: where
    the effect should show. by_clock: whether its time is by the clock."""

    place: str
    off: str
    switch: Callable[[str], None]
    workloads: tuple[str, ...]
    by_clock: bool = False

    @property
    def name(self) -> str:
        return f"{self.place}: {self.off}"


def at_once(place: str, *workloads: str) -> Entry:
    """The size of a chunk."""
    return Entry(place, "unlimited", set_to(UNLIMITED), workloads)


ARRAYS, MESH, SURFACE = "core.arrays.", "core.mesh.", "core.surface."
DEPTH, BOUNDS, DEVIATION = "core.depth.", "core.bounds.", "core.deviation."
REDUCTION = "core.reduction."
ADAPTIVE = "core.adaptive."
CERTIFIED = DEPTH + "certified_depth."
DEVIATIONS = ("deviation", "deviation, creases", "deviation, moved", "deviation, far")
ALL_ADAPTIVE = ("adaptive", "adaptive, creases", "adaptive, triangles", "adaptive, n-gons", "adaptive, pole")

REDUCED = ("reduced", "reduced, uneven")
THREADS = ("threads", "threads, small")
NETS = ("adaptive", "adaptive, coarse", "adaptive, pole")
SUZANNE = ("adaptive", "adaptive, coarse")
EXTRAORDINARY = ("adaptive, pole", "adaptive, coarse")
IRREGULAR = ("adaptive, creases", "adaptive, triangles", "adaptive, n-gons")
NOT_REGULAR = ("depths, extraordinary", "depths, creases")

ENTRIES = [
    # Arrays.
    Entry(ARRAYS + "threads._thread_count", "one thread", by(one_thread), THREADS, by_clock=True),
    Entry(ARRAYS + "threads._threads", "new ones for each call", by(a_pool_each), THREADS, by_clock=True),
    Entry(ARRAYS + "matrix_products.matrix_product", "numpy's own", by(numpy_product), ("depths", "adaptive")),
    at_once(ARRAYS + "matrix_products.ON_ONE_THREAD", "depths", "adaptive", "depths, extraordinary"),
    at_once(ARRAYS + "chunks.AT_ONCE", "depths", "depths, limit", "writing", "deviation", "adaptive, large"),
    at_once(ARRAYS + "chunks.FEW_AT_ONCE", *DEVIATIONS, "depths by norms, creases", "adaptive, n-gons"),
    Entry(ARRAYS + "vectors.cross_products", "numpy's own", by(numpy_cross), ("adaptive", "adaptive, n-gons")),
    Entry(ARRAYS + "vectors.squared_norms", "einsum", by(numpy_norms), ("depths", "adaptive", "deviation")),
    Entry(ARRAYS + "vectors.dot_products", "einsum", by(numpy_dots), SUZANNE),
    Entry(
        ARRAYS + "vectors.sums_by_index", "np.add.at", by(summed_one_by_one), ("depths, creases", "adaptive, triangles")
    ),
    # Meshes.
    Entry(
        MESH + "polygon_mesh.PolygonMesh.changed",
        "topology computed anew",
        by(no_topology),
        ("small depths", "writing", "depths by norms", "poses"),
    ),
    # The surface.
    Entry(
        SURFACE + "stencils.LARGEST_STENCIL_VALENCE",
        "all valences by stencils",
        set_to(1 << 20),
        ("adaptive, large pole", "depths, pole"),
    ),
    Entry(SURFACE + "stencils.LARGEST_STENCIL_VALENCE", "none by stencils", set_to(0), EXTRAORDINARY),
    Entry(
        SURFACE + "refinement.Refinement.limits_at_corners",
        "limits of descendants found anew",
        by(forgotten_limits),
        ("depths, creases", "adaptive, creases"),
    ),
    # Depths.
    at_once(CERTIFIED + "OTHER_FACES_AT_ONCE", "depths, extraordinary", "depths, creases"),
    Entry(CERTIFIED + "OTHER_FACES_TOGETHER", "each chunk on its own", set_to(1 << 10), ("depths, large",)),
    Entry(CERTIFIED + "MOST_PIECES", "unlimited", set_to(UNLIMITED), ("depths, undecidable",)),
    Entry(
        CERTIFIED + "_CertifiedSearch._evaluate_corners",
        "not tried first",
        by(nothing),
        ("depths, extraordinary", "depths, trapezohedron"),
    ),
    Entry(
        DEPTH + "base_patches.RegularPatches.rough_bounds",
        "bounds by the norm alone not tried",
        by(no_norms),
        ("depths, extraordinary", "depths, creases", "level"),
    ),
    Entry(CERTIFIED + "_CertifiedSearch._settle_early", "not tried", by(nothing), ("level", "deep level")),
    at_once(DEPTH + "norm_depth.EXTRAORDINARY_POINTS_AT_ONCE", "depths by norms, poles"),
    # Adaptive meshes: the tree and its stores.
    Entry(ADAPTIVE + "plan.SURELY_TOO_MANY", "not refused early", set_to(ALWAYS), ("adaptive, refused",)),
    # Adaptive meshes: cells and their bounds.
    # Attributes and writing.
    Entry("core.attributes.interpolation.at_corners", "at every corner", by(evaluated_everywhere), ("writing",)),
    # Deviation.
    Entry(DEVIATION + "surface_to_mesh.LOOKED_AT", "unlimited", set_to(UNLIMITED), DEVIATIONS),
    Entry(DEVIATION + "surface_to_mesh.SMALL_FOR_ONE", "one triangle always tried", set_to(ALWAYS), DEVIATIONS),
    Entry(DEVIATION + "surface_to_mesh.SMALL_FOR_ONE", "one triangle never tried", set_to(NEVER), DEVIATIONS),
    Entry(DEVIATION + "surface_to_mesh.NEARLY", "own normal always tried", set_to(ALWAYS), DEVIATIONS),
    Entry(DEVIATION + "surface_to_mesh.NEARLY", "own normal tried for lack of covering", set_to(NEVER), DEVIATIONS),
    Entry(DEVIATION + "findings.ROUNDS_FOR_FACES", "all rounds", set_to(UNLIMITED), DEVIATIONS),
    Entry(DEVIATION + "findings.SHARE_OF_LARGEST", "0", set_to(0.0), DEVIATIONS),
    Entry(DEVIATION + "mesh_to_surface.LOOKED_AT", "unlimited", set_to(UNLIMITED), DEVIATIONS),
    Entry(DEVIATION + "mesh_to_surface.MEASURED", "unlimited", set_to(UNLIMITED), DEVIATIONS),
    Entry(DEVIATION + "mesh_to_surface.GROWN", "tree never made anew", set_to(ALWAYS), DEVIATIONS),
    Entry(DEVIATION + "mesh_to_surface.GROWN", "tree made anew each round", set_to(0.0), DEVIATIONS),
    Entry(DEVIATION + "box_tree.BRANCHES", "2", set_to(2), DEVIATIONS),
    Entry(DEVIATION + "box_tree.BRANCHES", "32", set_to(32), DEVIATIONS),
    Entry(DEVIATION + "box_tree.TRIED", "1", set_to(1), DEVIATIONS),
    Entry(DEVIATION + "box_tree.FAR", "no points are far", set_to(ALWAYS), DEVIATIONS),
    Entry(DEVIATION + "measure.TRIANGLES_OF_A_UNIT", "units of one level", set_to(UNLIMITED), DEVIATIONS),
    Entry(DEVIATION + "covering_pieces.EXCESS_SHARE", "excess always in the way", set_to(0.0), DEVIATIONS),
    Entry(DEVIATION + "covering_pieces.EXCESS_SHARE", "excess never in the way", set_to(ALWAYS), DEVIATIONS),
    at_once(DEVIATION + "covering_pieces.MOST_UNITS_ACROSS", *DEVIATIONS),
    at_once(DEVIATION + "covering_pieces.LEAVES_OVER_AT_ONCE", *DEVIATIONS, "deviation, planar"),
    at_once(DEVIATION + "covering_triangles.MOST_TRIANGLES_ACROSS", *DEVIATIONS),
    Entry(DEVIATION + "covering_pieces.MOVED_MORE", "1", set_to(1.0), DEVIATIONS),
    Entry(DEVIATION + "covering_pieces.LEAST_STRAIGHTNESS", "0", set_to(0.0), DEVIATIONS),
    # Reduce.
    Entry(REDUCTION + "search.LARGEST_SHARE", "all that can go", set_to(1.0), REDUCED),
    Entry(REDUCTION + "search.LEAST_SHARE", "0.02", set_to(0.02), REDUCED),
    Entry(REDUCTION + "search.LARGE_SHARE", "vertices fixed at once", set_to(ALWAYS), REDUCED),
    Entry(REDUCTION + "search.LARGE_SHARE", "vertices never fixed", set_to(NEVER), REDUCED),
    Entry(REDUCTION + "search.MOST_REFUSALS", "unlimited", set_to(UNLIMITED), REDUCED),
    Entry(REDUCTION + "search.LEAST_GAIN", "0.01", set_to(0.01), REDUCED),
    Entry(REDUCTION + "search.SURELY_WITHIN", "each result proved", set_to(NEVER), REDUCED),
    Entry(REDUCTION + "search.SURELY_WITHIN", "proved in the end", set_to(1.0), REDUCED),
    Entry(REDUCTION + "search.NEARLY_BEYOND", "all that is not proved", set_to(NEVER), REDUCED),
    Entry("tasks.reduce_task.DIVISORS", "2", set_to((2.0,)), REDUCED),
    Entry("operators.reduced_meshes.ROUNDS_FOR_LINES", "none", set_to(0), REDUCED),
    Entry("operators.reduced_meshes.ROUNDS_FOR_LINES", "1", set_to(1), REDUCED),
    # Blender's side.
    at_once("exchange.evaluated.OBJECTS_AT_ONCE", "objects with modifiers"),
    Entry("exchange.control_mesh.read", "shared meshes read each time", by(not_shared), ("objects",)),
    Entry(
        "exchange.dependencies.object_state",
        "other objects described each time",
        by(not_known),
        ("objects with modifiers",),
    ),
]


# The caches, by their names in the table, all counted in one run.
TOPOLOGY = "face_sizes", "corner_faces", "next_corner", "previous_corner", "edge_face_counts", "vertex_face_counts"
TABLES = {
    SURFACE + "triangle_coefficients": ("arguments_of", "_ways_to_share", "_coefficients_over"),
    ADAPTIVE + "template_rows": ("_off_template",),
    ADAPTIVE + "surface_pieces": ("parts_of",),
}
CACHES = {
    "topology": [MESH + f"polygon_mesh.PolygonMesh.{name}" for name in (*TOPOLOGY, "_twins")],
    # Some are made from others.
    "tables": [f"{module}.{name}" for module, names in TABLES.items() for name in names],
    **{
        place: [place]
        for place in (
            SURFACE + "stencils.patch_stencils",
            BOUNDS + "facet_bounds._samples",
            ADAPTIVE + "subdivided_mesh.SubdividedMesh.corner_points",
            DEVIATION + "bezier_pieces.BezierPieces.edge_units",
            "exchange.control_mesh.ControlTopology.key",
            "exchange.control_mesh.ControlTopology.mesh",
            "exchange.dependencies._kept_fields",
        )
    },
}


# Runs


def run_each(workload: str, names: list[str]) -> None:
    """Do the work once for each thing to switch off, by name, or none, in processes that begin once the input is made.
    Prints the time of each."""
    if not workload.startswith("threads"):
        one_thread()
    work = WORKLOADS[workload]()
    threads: Any = importlib.import_module(PACKAGE + ".core.arrays.threads")
    for name in names:
        # Threads do not come along.
        threads._threads.cache_clear()
        if not (child := os.fork()):
            print(json.dumps(run(work, next((each for each in ENTRIES if each.name == name), None))), flush=True)
            os._exit(0)
        if os.waitpid(child, 0)[1]:
            raise SystemExit(f"without {name or 'nothing'}")


def run(work: Callable[[], Any], entry: Entry | None) -> Figures:
    """Do the work in this process, with one thing switched off."""
    if entry is not None:
        entry.switch(entry.place)
    before = memory(peak=False)
    start, clock = processor_time(), perf_counter()
    result = work()
    return {
        "time": processor_time() - start,
        "clock": perf_counter() - clock,
        "memory": max(memory(peak=True) - before, 1),
        "faces": float(result),
    }


def run_counting(workload: str) -> Figures:
    """Do the work in this process: its time, and by the name of each cache the time without it."""
    one_thread()
    work = WORKLOADS[workload]()
    counted = {name: [count_anew(place) for place in places] for name, places in CACHES.items()}
    start = processor_time()
    work()
    total = processor_time() - start - sum(each["counting"] for cache in counted.values() for each in cache)
    return {"time": total, **{name: total + sum(each["anew"] for each in cache) for name, cache in counted.items()}}


def processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def memory(*, peak: bool) -> float:
    """The memory of this process in kilobytes: at present, with the peak counted from now on, or the peak."""
    if not peak:
        Path("/proc/self/clear_refs").write_text("5")
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith("VmHWM:" if peak else "VmRSS:")))


class Measurement:
    """Runs in processes of their own, with inputs in a directory. found: runs with and without each thing."""

    def __init__(self, inputs: str, results: Path | None) -> None:
        self.inputs, self.results = inputs, results
        self.found: Found = defaultdict(list)
        if results and results.exists():
            for line in results.read_text().splitlines():
                name, workload, *figures = json.loads(line)
                self.found[name, workload].append(tuple(figures))

    def of_entries(self, entries: list[Entry], workload: str) -> None:
        """Measure each entry, in turn with everything on."""
        for start in range(0, len(entries), RUNS_BETWEEN):
            names = [each.name for each in entries[start : start + RUNS_BETWEEN]]
            # Blender's own threads do not come along to another process.
            together = [["", *names]] if workload not in IN_BLENDER else [[name] for name in ["", *names]]
            on, *without = [found for part in together for found in self._run("--run", workload, *part)]
            for name, figures in zip(names, without, strict=True):
                self._note(name, workload, on, figures)

    def of_caches(self, names: list[str], workload: str) -> None:
        """Measure all caches at once."""
        (counted,) = self._run("--count", workload)
        for name in names:
            rest = {"clock": 1.0, "memory": 1.0, "faces": 1.0}
            self._note(name, workload, {"time": counted["time"], **rest}, {"time": counted[name], **rest})

    def _run(self, *options: str) -> list[Figures]:
        command = ["nice", "-n", "5", sys.executable, __file__, *options]
        environment = {**os.environ, "CCDEPTH_INPUTS": self.inputs, "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{options}: {done.stderr[-2000:]}")
        return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]

    def _note(self, name: str, workload: str, on: Figures, without: Figures) -> None:
        self.found[name, workload].append((on, without))
        if self.results:
            with self.results.open("a") as file:
                file.write(json.dumps([name, workload, on, without]) + "\n")


# The table


def table(entries: list[Entry], caches: list[str], found: Found) -> str:
    lines = ["| what | where | off means | time | memory | faces |", "|---|---|---|---|---|---|"]
    for entry in entries:
        if ratios := ratios_of(found, entry.name):
            time = largest(ratios, "clock" if entry.by_clock else "time") + (" by the clock" if entry.by_clock else "")
            gains = [time, largest(ratios, "memory"), largest(ratios, "faces")]
            lines.append(row(entry.place, entry.off, gains))
    for name in caches:
        if ratios := ratios_of(found, name):
            place = name if len(CACHES[name]) == 1 else CACHES[name][0].rpartition(".")[0] + "." + name
            lines.append(row(place, "computed anew", [largest(ratios, "time"), "", ""]))
    return "\n".join(lines)


def row(place: str, off: str, gains: list[str]) -> str:
    """The row of an entry. place: the last part of the module's name, then the name there, also of a class's member."""
    names = place.split(".")
    at = len(names) - (3 if len(names) > 2 and names[-2].strip("_")[0].isupper() else 2)
    cells = [f"`{'.'.join(names[at + 1 :])}`", f"`{names[at]}`" if at >= 0 else "", off, *gains]
    return f"| {' | '.join(cells)} |"


def ratios_of(found: Found, name: str) -> dict[str, Figures]:
    """The ratios without a thing to with it, by workload: of the least times, and of the medians of the others."""
    ratios = {}
    for (of, workload), pairs in found.items():
        if of == name:
            medians = {key: median(without[key] / on[key] for on, without in pairs) for key in ("memory", "faces")}
            least = {
                key: min(without[key] for _, without in pairs) / min(on[key] for on, _ in pairs)
                for key in ("time", "clock")
            }
            ratios[workload] = {**medians, **least}
    return ratios


def largest(ratios: dict[str, Figures], key: str) -> str:
    workload = max(ratios, key=lambda name: ratios[name][key])
    ratio = ratios[workload][key]
    return f"{ratio:.2f}" + (f" ({workload})" if ratio > 1 + NOISE and len(ratios) > 1 else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of the names of things; all by default")
    parser.add_argument(
        "--repeat", type=int, default=5, help="how often each is run; of 0 the results so far are shown"
    )
    parser.add_argument("--results", type=Path, help="a file to which measurements are appended")
    parser.add_argument("--workload", action="append", default=[], choices=WORKLOADS)
    parser.add_argument("--run", nargs="+", help=argparse.SUPPRESS)
    for hidden in ("--count", "--save-inputs"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.save_inputs:
        save_suzanne(given.save_inputs)
    elif given.run:
        run_each(given.run[0], given.run[1:] or [""])
    elif given.count:
        print(json.dumps(run_counting(given.count)))
    else:
        measure(given)
    # The bpy wheel may hang when the interpreter exits.
    sys.stdout.flush()
    os._exit(0)


def measure(given: argparse.Namespace) -> None:
    def is_wanted(name: str) -> bool:
        return not given.names or any(part in name for part in given.names)

    entries, caches = [each for each in ENTRIES if is_wanted(each.name)], [name for name in CACHES if is_wanted(name)]
    workloads = given.workload or list(WORKLOADS)
    with tempfile.TemporaryDirectory() as inputs:
        subprocess.run([sys.executable, __file__, "--save-inputs", inputs], cwd=ROOT, check=True, capture_output=True)
        measurement = Measurement(inputs, given.results)
        for number in range(given.repeat):
            for workload in workloads:
                measurement.of_entries([each for each in entries if workload in each.workloads], workload)
                if caches and not number:
                    measurement.of_caches(caches, workload)
    print(f"{os.cpu_count()} processors, numpy {importlib.import_module('numpy').__version__}\n")
    print(table(entries, caches, measurement.found))


if __name__ == "__main__":
    main()
