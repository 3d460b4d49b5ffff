# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest angles between drawn normals and the limit surface's, at dense samples, which prove nothing.

A sample passes an angle if a point of the other side within twice the tolerance has a normal within the angle: its own
angle is the smallest of such points, whatever sheet they lie on. A sample does not count where the surface's own normal
turns by its angle or more within the tolerance: such a part of the surface is too narrow to count. docs/deviation.md,
Angles.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks, index_chunks
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import angles_between, cross_products, dot_products, lengths, units
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.evaluation import limit_values
from ..surface.limit_normals import limit_normals
from ..surface.surface_points import SurfacePoints
from .box_tree import FAR, first_of_each
from .surface_to_mesh import NearestTriangles, nearest_triangles
from .triangles import Triangles, barycentric

Tick = Callable[[], None]

# Samples of the surface lie closer while its normal turns by more than this from one to the next (radians).
TURN = np.radians(2.0)

# The largest number of samples of the surface, unless its first samples are more, and of a drawn mesh, about.
MOST_SAMPLES = 1 << 15

# Samples of the surface need not lie closer than this part of the tolerance.
CLOSEST = 0.5

# Points count for each other within this many tolerances, as in the proof of docs/normals.md.
REACH = 2.0

# The largest tolerance counted with, as a part of the diagonal: with a larger one nearly all points would count.
MOST_REACH = 0.02

# The numbers of samples along the sides of a drawn triangle: the first that does not make too many.
DRAWN_STEPS = (4, 2, 1)

# Angles below this are not told apart (radians).
FLOOR = np.radians(0.01)

# The number of samples compared with all points within the tolerance at a time.
LOOKED_AT = 1 << 9

# The largest numbers of samples compared so for the largest angle, of those that count and of all: uniform meshes have
# many that are nearly alike.
MOST_LOOKED_AT, MOST_OF_ALL = 1 << 9, 1 << 12

# Points of a large triangle around a sample, in parts of its reach: the middle and a ring.
RING = 0.9 * np.array([[np.cos(turn), np.sin(turn)] for turn in np.arange(6) * np.pi / 3])

# The corners of the cells of a grid, in the order of the face.
QUAD_CORNERS = (
    (slice(None, -1), slice(None, -1)),
    (slice(1, None), slice(None, -1)),
    (slice(1, None), slice(1, None)),
    (slice(None, -1), slice(1, None)),
)


@dataclass(frozen=True)
class Shaded:
    """T triangles with normals. normals: (3, T, 3) float64, unit vectors at their corners, interpolated in between."""

    triangles: Triangles
    normals: FloatArray

    @staticmethod
    def of(positions: FloatArray, corners: IndexArray, normals: FloatArray | None, tick: Tick) -> Shaded:
        """A mesh with normals (T, 3, 3) at the corners of its triangles (T, 3), or with the triangles' own."""
        triangles = Triangles.of(positions, corners, tick)
        if normals is None:
            return Shaded(triangles, np.broadcast_to(triangles.normals, (3, *triangles.normals.shape)))
        return Shaded(triangles, np.moveaxis(normals, 1, 0))

    def normals_at(self, which: IndexArray, points: FloatArray) -> FloatArray:
        """(P, 3): unit normals at points (P, 3) of triangles (P,)."""
        weights = barycentric(points, self.triangles.points[:, which])
        return units(np.einsum("pk,kpd->pd", weights, self.normals[:, which]))


@dataclass(frozen=True)
class Samples(Table):
    """N places (N, 3) with unit normals (N, 3), and the drawn triangle (N,) of each, if known."""

    places: FloatArray
    normals: FloatArray
    triangles: IndexArray | None = None


class SampledSurface:
    """The limit surface as a fine mesh with its own normals, each side of a crease by itself.

    control: with explicit sharpness. tolerance: points within twice this distance count for each other. tick: called
    again and again, here as in the methods; it may raise to stop. most: the number of samples of the surface, unless
    its first samples are more.
    """

    def __init__(self, control: PolygonMesh, tolerance: float, tick: Tick, most: int = MOST_SAMPLES) -> None:
        diagonal = float(np.linalg.norm(np.ptp(control.positions, axis=0)))
        self._tolerance = min(tolerance, MOST_REACH * diagonal)
        self._leaves_out_narrow = True
        positions, normals, corners = _fine_mesh(control, CLOSEST * self._tolerance, most, tick)
        step = len(positions) // most + 1
        self._samples = Samples(positions[::step], normals[::step])
        self._shaded = Shaded.of(positions, corners, normals[corners], tick)

    def largest_angles(
        self,
        positions: FloatArray,
        corners: IndexArray,
        normals: FloatArray | None,
        limit: float,
        tick: Tick,
        counts: BoolArray,
    ) -> FloatArray:
        """(T,) float64, radians: the largest angle found at each triangle of a drawn mesh, both ways, if above a limit.

        positions: (V, 3); corners: (T, 3) intp; normals: (T, 3, 3) unit vectors at their corners, to be interpolated,
        or None for the triangles' own. counts: (T,) the triangles to look at.
        """
        drawn = Shaded.of(positions, corners, normals, tick)
        found = np.zeros(len(corners))
        for samples, other in ((_drawn_samples(drawn, counts), self._shaded), (self._samples, drawn)):
            near = _nearest(samples, other, tick)
            angles, which = self._compare(samples, other, near, limit, counts, tick)
            np.maximum.at(found, which, angles)
        return found

    def largest_of_all(
        self, positions: FloatArray, corners: IndexArray, kinds: list[FloatArray | None], tick: Tick
    ) -> list[float]:
        """The largest angle (radians) found on a drawn mesh, both ways, for each kind of normals as of
        ``largest_angles``."""
        every = [Shaded.of(positions, corners, normals, tick) for normals in kinds]
        counts, chosen = np.ones(len(corners), dtype=bool), np.zeros(len(corners), dtype=bool)
        chosen[:: 3 * len(corners) // MOST_SAMPLES + 1] = True
        found = [0.0] * len(kinds)
        to_surface, to_drawn = None, _nearest(self._samples, every[0], tick)
        for i, drawn in enumerate(every):
            samples = _drawn_samples(drawn, chosen)
            to_surface = to_surface or _nearest(samples, self._shaded, tick)
            for own, other, near in ((samples, self._shaded, to_surface), (self._samples, drawn, to_drawn)):
                enough = max(found[i], FLOOR)
                angles, _ = self._compare(own, other, near, enough, counts, tick, only_largest=True)
                found[i] = max(found[i], float(angles.max(initial=0.0)))
        return found

    def kept_by(
        self, positions: FloatArray, corners: IndexArray, normals: FloatArray | None, limit: float, tick: Tick
    ) -> SampledSurface:
        """The surface with the samples alone that have at most an angle (radians) with a drawn mesh. As no part of it
        is too narrow for this mesh, none is left out with others."""
        kept = copy(self)
        kept._leaves_out_narrow = False
        drawn, counts = Shaded.of(positions, corners, normals, tick), np.ones(len(corners), dtype=bool)
        near = _nearest(self._samples, drawn, tick)
        is_kept = kept._compare(self._samples, drawn, near, limit, counts, tick)[0] <= limit
        kept._samples = self._samples.at(is_kept)
        return kept

    def normals_of(self, positions: FloatArray, corners: IndexArray, same: float, tick: Tick) -> FloatArray:
        """(T, 3, 3): the normals of the surface for the corners of triangles (T, 3), each on the triangle's own side.

        The nearest point within the tolerance counts whose normal is within ``same`` (radians) of the triangle's, or
        else the point with the best normal: so beside creases, and parts too narrow to count, a corner gets the normal
        from inside.
        """
        places, own = positions[corners].reshape(-1, 3), np.repeat(_facet_normals(positions, corners), 3, axis=0)
        result, reach = np.empty_like(places), np.empty(len(places))
        for part in chunks(len(places), AT_ONCE):
            nearest = nearest_triangles(self._shaded.triangles, places[part])
            result[part] = self._shaded.normals_at(nearest.which, nearest.points)
            reach[part] = np.maximum(nearest.distances, self._tolerance)
            tick()
        for block in index_chunks(np.flatnonzero(angles_between(result, own) > same), LOOKED_AT):
            owners, normals, distances = _within(places[block], reach[block], self._shaded)
            off = angles_between(own[block][owners], normals)
            fits = off <= np.maximum(off[first_of_each(owners, off, len(block))], same)[owners]
            result[block] = normals[first_of_each(owners, np.where(fits, distances, np.inf), len(block))]
            tick()
        return result.reshape(*corners.shape, 3)

    def _compare(
        self,
        samples: Samples,
        other: Shaded,
        near: NearestTriangles,
        enough: float,
        counts: BoolArray,
        tick: Tick,
        *,
        only_largest: bool = False,
    ) -> tuple[FloatArray, IndexArray]:
        """(N,) twice: the angles of samples with the other side, at most 0 for those that do not count or are hardly
        above ``enough``; and the triangles they belong to.

        near: of the samples. only_largest: look at a part, for the largest of all.
        """
        angles = angles_between(samples.normals, other.normals_at(near.which, near.points))
        triangles = near.which if samples.triangles is None else samples.triangles
        angles[~counts[triangles]] = 0.0
        is_far = near.distances > REACH * self._tolerance
        found, counted = np.where(is_far, angles, 0.0), 0
        angles[is_far] = 0.0
        if only_largest:
            enough = max(enough, found.max(initial=0.0))
        order = np.argsort(-angles, kind="stable")
        for block in index_chunks(order[:MOST_OF_ALL] if only_largest else order, LOOKED_AT):
            block = block[angles[block] > enough]
            if not len(block) or (only_largest and counted >= MOST_LOOKED_AT):
                break
            found[block] = self._smallest(samples, block, other, enough)
            if only_largest:
                enough = max(enough, found[block].max())
                counted += np.count_nonzero(found[block] >= 0.0)
            tick()
        return found, triangles

    def _smallest(self, samples: Samples, block: IndexArray, other: Shaded, enough: float) -> FloatArray:
        """(n,): the smallest angles of samples with points in reach; -1 where one above ``enough`` is left out."""
        places, own = samples.places[block], samples.normals[block]
        owners, normals, distances = _within(places, np.full(len(block), REACH * self._tolerance), other)
        angles = angles_between(own[owners], normals)
        best = first_of_each(owners, angles, len(block))
        if not self._leaves_out_narrow:
            return angles[best]
        if other is self._shaded:
            own, is_near = normals[best], distances <= self._tolerance
            owners, normals = owners[is_near], normals[is_near]
        else:
            owners, normals, _ = _within(places, np.full(len(block), self._tolerance), self._shaded)
        turns = angles_between(own[owners], normals)
        turn = np.zeros(len(block))
        # Beyond a right angle it is another sheet.
        np.maximum.at(turn, owners, np.where(turns < np.pi / 2, turns, 0.0))
        return np.where((turn < angles[best]) | (angles[best] <= enough), angles[best], -1.0)


def _within(places: FloatArray, reach: FloatArray, shaded: Shaded) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Points within reach (P,) of places (P, 3): of each point its place (K,), its normal (K, 3), and its distance."""
    triangles = shaded.triangles
    reach = reach * (1 + 1e-9)
    owners, which = triangles.tree.within(places, _held(triangles, places, reach))
    distances, points = triangles.distances(places[owners], which)
    is_near = distances <= reach[owners]
    owners, which, distances, points = owners[is_near], which[is_near], distances[is_near], points[is_near]
    found = [(owners, shaded.normals_at(which, points), distances)]
    a, b, c = triangles.points[:, which]
    large = np.flatnonzero(np.maximum(lengths(b - a), lengths(c - a)) > reach[owners])
    owners, which, along = owners[large], which[large], units((b - a)[large])
    across = cross_products(triangles.normals[which], along)
    for x, y in RING:
        places_beside = places[owners] + reach[owners][:, None] * (x * along + y * across)
        points = triangles.distances(places_beside, which)[1]
        distances = lengths(points - places[owners])
        near = np.flatnonzero(distances <= reach[owners])
        found.append((owners[near], shaded.normals_at(which[near], points[near]), distances[near]))
    owners = np.concatenate([part[0] for part in found])
    return owners, np.concatenate([part[1] for part in found]), np.concatenate([part[2] for part in found])


def _held(triangles: Triangles, places: FloatArray, reach: FloatArray) -> FloatArray:
    """(P,): reach (P,), but no more than reaches the triangles near a place where these are far smaller."""
    held, beyond = reach.copy(), np.flatnonzero(reach > FAR * triangles.tree.size)
    if len(beyond):
        nearest = nearest_triangles(triangles, places[beyond]).distances + triangles.slack.max()
        held[beyond] = np.minimum(reach[beyond], np.maximum(nearest * (1 + 1e-9), FAR * triangles.tree.size))
    return held


def _facet_normals(positions: FloatArray, corners: IndexArray) -> FloatArray:
    a, b, c = np.moveaxis(positions[corners], 1, 0)
    return units(cross_products(b - a, c - a))


def _nearest(samples: Samples, other: Shaded, tick: Tick) -> NearestTriangles:
    """The triangles of the other side nearest to samples."""
    found = NearestTriangles(np.zeros(0), np.zeros(0, dtype=np.intp), np.zeros((0, 3)))
    parts = []
    for some in chunks(len(samples.places), AT_ONCE):
        parts.append(nearest_triangles(other.triangles, samples.places[some]))
        tick()
    return found.joined(parts)


def _drawn_samples(drawn: Shaded, counts: BoolArray) -> Samples:
    """Samples of the triangles that count and have an area: their corners, and points in even steps between."""
    chosen = np.flatnonzero(counts & drawn.triangles.normals.any(axis=1))
    steps = next((n for n in DRAWN_STEPS if len(chosen) * (n + 1) * (n + 2) // 2 <= MOST_SAMPLES), DRAWN_STEPS[-1])
    weights = np.array([(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]) / steps
    places, normals = (
        np.einsum("wk,ktd->wtd", weights, of_corners[:, chosen]).reshape(-1, 3)
        for of_corners in (drawn.triangles.points, drawn.normals)
    )
    return Samples(places, units(normals), np.tile(chosen, len(weights)))


def _fine_mesh(
    control: PolygonMesh, closest: float, most: int, tick: Tick
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Positions (N, 3) and normals (N, 3) of samples of the limit surface, and triangles (T, 3) between them.

    Each quarter of a control face has a grid of its own, which becomes twice as fine until neighbours are ``closest``
    or differ little in their normals.
    """
    found: list[tuple[FloatArray, FloatArray, IndexArray]] = []
    left, steps, total = np.arange(len(control.corner_vertices)), 2, 0
    while len(left):
        grid = np.stack(np.meshgrid(*2 * [np.arange(steps + 1) / steps], indexing="ij"), axis=-1).reshape(-1, 2)
        points = SurfacePoints(np.repeat(left, len(grid)), np.tile(grid, (len(left), 1)))
        shape = (len(left), steps + 1, steps + 1, 3)
        positions = limit_values(control, control.positions, points).reshape(shape)
        tick()
        normals = limit_normals(control, points).reshape(shape)
        tick()
        is_fine = np.ones(len(left), dtype=bool)
        for one, other in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[:, :, 1:], np.s_[:, :, :-1])):
            is_close = lengths(positions[one] - positions[other]) <= closest
            is_fine &= (is_close | (dot_products(normals[one], normals[other]) >= np.cos(TURN))).all(axis=(1, 2))
        if total + 4 * len(grid) * np.count_nonzero(~is_fine) > most:
            is_fine[:] = True
        total += int(np.count_nonzero(is_fine)) * len(grid)
        quads = np.arange(len(grid)).reshape(steps + 1, steps + 1)
        a, b, c, d = (quads[rows, columns].ravel() for rows, columns in QUAD_CORNERS)
        triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        first = len(grid) * np.arange(np.count_nonzero(is_fine))
        found.append(
            (
                positions[is_fine].reshape(-1, 3),
                normals[is_fine].reshape(-1, 3),
                (first[:, None, None] + triangles).reshape(-1, 3),
            )
        )
        left, steps = left[~is_fine], 2 * steps
    offsets = np.cumsum([0, *(len(part[0]) for part in found)])
    corners = [part[2] + offset for part, offset in zip(found, offsets, strict=False)]
    positions, normals = (np.concatenate([part[column] for part in found]) for column in (0, 1))
    return positions, normals, np.concatenate(corners)
