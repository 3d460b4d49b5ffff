# SPDX-License-Identifier: GPL-3.0-or-later
"""Single polygons in space, what may be drawn of them, and how far two such things are from each other.

A loop is (N, 3), its vertices in order; some may stand for middles of sides between the others, its corners.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.polygon_bounds import polygon_thickness
from tests.triangle_distances import distances

Triangle = tuple[int, int, int]

IDENTITY = np.eye(3)

# Steps along a side where a facet or a triangle is sampled.
STEPS = 6

# Triangles of less than this area, doubled, are none: their vertices lie in one line but for rounding.
LEAST_AREA = 1e-9


@dataclass(frozen=True)
class Loop:
    """corners: (N, 3); middles: (N, 3) of the sides after them, which are vertices where ``bent``, (N,) bool."""

    corners: FloatArray
    middles: FloatArray
    bent: np.ndarray

    @property
    def vertices(self) -> FloatArray:
        both = np.stack([self.corners, self.middles], axis=1).reshape(-1, 3)
        return both[np.stack([np.ones_like(self.bent), self.bent], axis=1).ravel()]

    @property
    def facets(self) -> FloatArray:
        """(4, N, 3): the fan over corner, middle of the side after it, centroid, middle of the side before."""
        centroid = np.broadcast_to(self.corners.mean(axis=0), self.corners.shape)
        return np.stack([self.corners, self.middles, centroid, np.roll(self.middles, 1, axis=0)])

    def thickness(self, axes: FloatArray = IDENTITY) -> tuple[float, FloatArray]:
        """As the core has it, where Blender sees it in the same space or in that of the axes; and the normal."""
        [thickness] = polygon_thickness(self.facets, self.bent, np.array([0]), axes)
        return float(thickness), self.normal()

    def normal(self) -> FloatArray:
        """Newell's, a unit vector, or zero."""
        sum_of_crosses = np.cross(self.vertices, np.roll(self.vertices, -1, axis=0)).sum(axis=0)
        length = np.linalg.norm(sum_of_crosses)
        return sum_of_crosses / length if length > 0 else sum_of_crosses


def plain(corners: FloatArray) -> Loop:
    """A loop with straight sides."""
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    return Loop(corners, middles, np.zeros(len(corners), dtype=bool))


def random_loop(seed: int, size: int, unevenness: float, height: float, bent_share: float) -> Loop:
    """A convex polygon with its vertices off it by so much within the plane, and so much across; some sides bent.

    It is turned and moved at random.
    """
    generator = np.random.default_rng(seed)
    angles = 2 * np.pi * np.arange(size) / size
    corners = np.stack([np.cos(angles), np.sin(angles), np.zeros(size)], axis=1)
    corners[:, :2] += unevenness * generator.uniform(-1, 1, (size, 2))
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    bent = generator.random(size) < bent_share
    middles[bent, :2] += unevenness / 2 * generator.uniform(-1, 1, (size, 2))[bent]
    corners[:, 2] = height * generator.uniform(-1, 1, size)
    heights = (corners[:, 2] + np.roll(corners[:, 2], -1)) / 2
    middles[:, 2] = np.where(bent, height * generator.uniform(-1, 1, size), heights)
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    away = generator.uniform(-3, 3, 3)
    return Loop(corners @ turn + away, middles @ turn + away, bent)


def seen_along(points: FloatArray, normal: FloatArray) -> FloatArray:
    """(…, 2): points in the plane across the normal, which looks at the viewer."""
    aside = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    aside /= np.linalg.norm(aside)
    return points @ np.stack([aside, np.cross(normal, aside)], axis=1)


def doubled_area(triangle: FloatArray) -> float:
    """Of (3, 2), positive where it goes round counter-clockwise."""
    (ax, ay), (bx, by), (cx, cy) = triangle.tolist()
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def drawn_ways(vertices: FloatArray, normal: FloatArray, tries: int) -> list[list[Triangle]]:
    """Triangulations of the region that the polygon is seen as, all of whose triangles face the normal.

    Found by cutting ears off at random. Where vertices lie in one line that may come to nothing, so it is tried again.
    """
    flat = seen_along(vertices, normal)
    found = (cut(len(flat), np.random.default_rng(seed), lambda *at: _is_ear(flat, *at)) for seed in range(tries))
    return [triangles for triangles in found if triangles]


def cut(count: int, generator: np.random.Generator, is_ear: Callable[..., bool] = lambda *_: True) -> list[Triangle]:
    """Triangles between so many vertices, counter-clockwise; none where no ear is left before the end."""
    left, triangles = list(range(count)), []
    while len(left) >= 3:
        ears = [place for place in range(len(left)) if is_ear(left, place)]
        if not ears:
            return []
        place = int(generator.choice(ears))
        triangles.append((left[place - 1], left[place], left[(place + 1) % len(left)]))
        del left[place]
    return triangles


def _is_ear(flat: FloatArray, left: list[int], place: int) -> bool:
    """Whether the triangle at a vertex turns left and holds no other vertex."""
    ear = [left[place - 1], left[place], left[(place + 1) % len(left)]]
    if doubled_area(flat[ear]) <= LEAST_AREA:
        return False
    return not any(
        all(doubled_area(flat[[ear[side - 1], ear[side], other]]) >= 0 for side in range(3))
        for other in left
        if other not in ear
    )


def is_simple(vertices: FloatArray, normal: FloatArray) -> bool:
    """Whether the polygon, seen along the normal, goes round once and never meets itself: by its sides, two by two."""
    flat = seen_along(vertices, normal)
    count = len(flat)
    for i in range(count):
        for j in range(i + 2, count - (i == 0)):
            a, b, c, d = flat[i], flat[(i + 1) % count], flat[j], flat[(j + 1) % count]
            across = doubled_area(np.stack([a, b, c])) * doubled_area(np.stack([a, b, d]))
            along = doubled_area(np.stack([c, d, a])) * doubled_area(np.stack([c, d, b]))
            if across <= 0 and along <= 0:
                return False
    return True


def facet_triangles(facets: FloatArray) -> FloatArray:
    """(T, 3, 3): bilinear facets (4, N, 3), finely cut into triangles."""
    along = np.linspace(0, 1, STEPS + 1)
    u, v = np.meshgrid(along, along, indexing="ij")
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    grid = np.einsum("cuv,cnd->nuvd", weights, facets)
    a, b, c, d = grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=3), np.stack([a, c, d], axis=3)]).reshape(-1, 3, 3)


def twist_error(facets: FloatArray) -> float:
    """How far such triangles are from the facets they are cut from."""
    a, b, c, d = facets
    return float(np.linalg.norm(a - b + c - d, axis=1).max()) / (4 * STEPS**2)


def farthest(points: FloatArray, triangles: FloatArray) -> float:
    """The largest distance of points (P, 3) from the nearest of triangles (T, 3, 3)."""
    return float(distances(points, triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), 0.0).max())
