# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with every kind of face, by name: those that depths and adaptive meshes are measured on."""

from collections.abc import Callable

from tests import meshes
from tests.blender import scene


def suzanne_once() -> meshes.MeshData:
    """Suzanne after one step."""
    base = scene.add_suzanne()
    scene.add_subdivision(base, 1)
    return scene.evaluated_mesh_data(base)


NAMED: dict[str, Callable[[], meshes.MeshData]] = {
    "Suzanne": scene.suzanne,
    "Suzanne after one step": suzanne_once,
    "cube": meshes.cube,
    "torus": lambda: meshes.torus(16, 12),
    "Suzanne with random creases": lambda: meshes.with_random_creases(scene.suzanne(), share=0.1),
    "landscape with boundary": lambda: meshes.landscape(16, 12),
    "landscape with random creases": lambda: meshes.with_random_creases(meshes.landscape(8, 8)),
    "collapsed faces": lambda: meshes.with_collapsed_faces(meshes.landscape(6, 5)),
    "collapsed n-gons": lambda: meshes.with_collapsed_faces(meshes.bumpy(meshes.cylinder(7), 0.1)),
    "valence 2": meshes.valence_two,
    **{f"valence {n}": (lambda n=n: meshes.fan(n, 3)) for n in (3, 5, 6, 7, 8)},
    **{f"valence {n}": (lambda n=n, rings=rings: meshes.fan(n, rings)) for n, rings in ((12, 2), (64, 1), (360, 1))},
    "valences 3 and 9": lambda: meshes.bumpy(meshes.trapezohedron(9), 0.05),
    "n-gons": lambda: meshes.bumpy(meshes.cylinder(7), 0.1),
    "triangles, quads, valence 12": lambda: meshes.bumpy(meshes.sphere(12, 2), 0.05),
    "n-gons with random creases": lambda: meshes.with_random_creases(meshes.cylinder(8), share=0.6),
    "valence 2 with random creases": lambda: meshes.with_random_creases(meshes.valence_two(), seed=5, share=0.8),
    "house with random creases": lambda: meshes.with_random_creases(meshes.triangles_and_quads()),
    "not manifold": lambda: meshes.with_random_creases(meshes.face_soup(), share=0.1),
}
