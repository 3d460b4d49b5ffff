# SPDX-License-Identifier: GPL-3.0-or-later
"""Control nets of single patches, their listed differences, and positions by parameter, apart from the core's own code.

Numbers V₁ … V₂ₙ₊₈ of extraordinary nets are those of Cheng, Chen and Yong 2006 (Stam's order), from 1.
"""

from math import ceil, log

import numpy as np

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule

Difference = tuple[int, int, int]


def spline_derivatives(places: FloatArray) -> list[FloatArray]:
    """(4, n) each: values, first and second derivatives of the uniform cubic B-splines at places (n,) from 0 to 1."""
    t = places
    values = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6
    slopes = np.stack([-3 * (1 - t) ** 2, 9 * t**2 - 12 * t, -9 * t**2 + 6 * t + 3, 3 * t**2]) / 6
    return [values, slopes, np.stack([1 - t, 3 * t - 2, 1 - 3 * t, t])]


def ring(valence: int, number: int) -> int:
    """V_number of the ring, whose numbers 2 … 2n + 1 wrap around."""
    return number - 2 * valence if number > 2 * valence + 1 else number


def listed_differences(valence: int) -> list[Difference]:
    """(a, b, c) for each second difference 2V_a - V_b - V_c as printed; 2n + 10 of them, the numbers from 1."""
    n = valence
    v7, v8 = ring(n, 7), ring(n, 8)
    differences = [(1, 2 * i, ring(n, 2 * (i + 2))) for i in range(1, n + 1)]
    differences += [(ring(n, 2 * (i + 1)), 2 * i + 1, ring(n, 2 * i + 3)) for i in range(1, n + 1)]
    o2, o3, o4, o5, o6, o7, o8 = range(2 * n + 2, 2 * n + 9)
    differences += [(3, 2, o8), (4, 1, o7), (5, 6, o6), (5, 4, o3), (6, 1, o4), (v7, v8, o5)]
    return [*differences, (o7, o6, o8), (o6, o2, o7), (o3, o2, o4), (o4, o3, o5)]


def difference_matrix(valence: int) -> FloatArray:
    """(2n + 10, 2n + 8): one listed difference per row."""
    a, b, c = np.eye(2 * valence + 8)[np.transpose(listed_differences(valence)) - 1]
    return 2 * a - b - c


def listed_regular_differences() -> list[tuple[tuple[int, int], tuple[int, int], tuple[int, int]]]:
    """The 16 second differences of a 4×4 net, as ((i, j), (i, j), (i, j)) for 2V_a - V_b - V_c."""
    along_i = [((i, j), (i - 1, j), (i + 1, j)) for i in (1, 2) for j in (0, 1, 2, 3)]
    along_j = [((i, j), (i, j - 1), (i, j + 1)) for i in (0, 1, 2, 3) for j in (1, 2)]
    return along_i + along_j


def net_faces(valence: int) -> list[list[int]]:
    """The faces that a net of 2n + 8 points has, with numbers from 0; the patch's own (V₁, V₆, V₅, V₄) first."""
    n = valence
    around = [[1, ring(n, 2 * i + 2), 2 * i + 1, 2 * i] for i in range(1, n + 1)]
    around.insert(0, around.pop(1))
    o2, o3, o4, o5, o6, o7, o8 = range(2 * n + 2, 2 * n + 9)
    outer = [[3, 4, o7, o8], [4, 5, o6, o7], [5, o3, o2, o6], [6, o4, o3, 5], [ring(n, 7), o5, o4, 6]]
    return [[number - 1 for number in face] for face in around + outer]


def net_edges(valence: int) -> list[tuple[int, int]]:
    """The edges of those faces, each once, with the numbers from 0."""
    pairs = [(face[i - 1], face[i]) for face in net_faces(valence) for i in range(4)]
    return sorted({(min(pair), max(pair)) for pair in pairs})


def edge_matrix(valence: int) -> FloatArray:
    """(edges, 2n + 8): one first difference per row."""
    a, b = np.eye(2 * valence + 8)[np.transpose(net_edges(valence))]
    return a - b


def net_mesh(positions: FloatArray) -> PolygonMesh:
    """The mesh of a net alone, face 0 the patch's, whose corner 0 is V₁. positions: (2n + 8, any number of columns).

    Its border is a boundary, which has no effect on face 0 and its surface.
    """
    faces = net_faces((len(positions) - 8) // 2)
    mesh = polygon_mesh(positions, np.full(len(faces), 4), np.concatenate(faces))
    return apply_boundary_rule(mesh, smooth_corners=True)


def stam_points(begun_with: dict[tuple[int, int], list[int]], v1: int, v6: int, valence: int) -> list[int]:
    """The vertices V₁ … V₂ₙ₊₈ of the face that has the directed edge from V₁ to V₆, found from quad to quad.

    begun_with: the vertices of each quad from a directed edge on.
    """
    at = {0: v1, 5: v6}
    turned = [face[i:] + face[:i] for face in net_faces(valence) for i in range(4)]
    while len(at) < 2 * valence + 8:
        for first, second, *others in turned:
            if first in at and second in at:
                at.update(zip(others, begun_with[at[first], at[second]][2:], strict=True))
    return [at[number] for number in range(len(at))]


def published_norms(mesh: PolygonMesh) -> dict[int, tuple[int, float]]:
    """For each quad of interior corners, all but one at the most of valence 4: the valence n of that one, and M.

    A mesh of quads, smooth inside. The differences are the listed ones (those of valence 4 are the 16 of a 4×4 net).
    """
    quads = mesh.corner_vertices.reshape(-1, 4).tolist()
    turned = [quad[i:] + quad[:i] for quad in quads for i in range(4)]
    begun_with = {(first, second): [first, second, *others] for first, second, *others in turned}
    border = {*mesh.edge_vertices[mesh.edge_face_counts == 1].ravel().tolist()}
    norms = {}
    for face, quad in enumerate(quads):
        valences = mesh.vertex_face_counts[quad]
        corner = int(np.argmax(valences != 4))
        n = int(valences[corner])
        if np.count_nonzero(valences != 4) < 2 and n != 2 and not border & {*quad}:
            points = mesh.positions[stam_points(begun_with, quad[corner], quad[(corner + 1) % 4], n)]
            norms[face] = n, float(np.linalg.norm(difference_matrix(n) @ points, axis=1).max())
    return norms


def published_depth(valence: int, norm: float, tolerance: float) -> int:
    """⌈log₄(M/3ε)⌉ (Theorem 3) or ⌈log_w(M/(zε))⌉ (Theorem 8), never below 0."""
    n = valence
    if n == 4:
        w, z = 4.0, 3.0
    elif n == 3:
        w, z = 3 / 2, 1.0
    elif n == 5:
        w, z = 25 / 18, 25 / 18
    else:
        w = 4 * n**2 / (3 * n**2 + 8 * n - 46)
        z = 25 / 18 if n <= 8 else 2 * (n**2 - 8 * n + 46) / n**2
    return max(0, ceil(log(norm / (z * tolerance), w)))


def refined(mesh: PolygonMesh, levels: int) -> PolygonMesh:
    for _ in range(levels):
        mesh = subdivide(mesh)
    return mesh
