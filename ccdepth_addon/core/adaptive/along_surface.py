# SPDX-License-Identifier: GPL-3.0-or-later
"""The third phase of a plan: leaves that exceed the limit at equal parameters, bounded by places in a shell.

Along the surface it does not count where parameters lie (docs/distance.md, Shells).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import groupby

import numpy as np

from ..arrays.chunks import chunks, index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..distance.leaf_surfaces import joined_tiles
from ..distance.pieces import Form, include_pieces
from ..distance.shell_bounds import Pieces
from ..distance.shells import Shell
from .cells.cell_store import in_blocks
from .leaf_triangles import LeafTriangles
from .plan import Plan
from .quadtree import NONE, Quadtree, any_of_slots
from .surface_pieces import ALL, SOME, DrawnTiles, grouped, over_triangles, parts_of, pieces_by_corners, pieces_over

# What a bound depends on is this many rings of leaves around: the triangles of the first and, by vectors at their
# vertices, those of the second.
RINGS = 2

# Levels of tiles around extraordinary vertices: more where what is left there is too large.
TILE_LEVELS = (3, 6, 14)

# Pieces looked at together, and so many as there are at once.
PIECES_AT_ONCE, MOST_PIECES = 1 << 13, 1 << 15

# Leaves whose tiles are there together.
LEAVES_AT_ONCE = 1 << 14


def bound_along_surface(plan: Plan) -> IndexArray:
    """Bound the leaves that exceed the limit at equal parameters, where anything around them has changed. Returns those
    that still exceed it."""
    unbounded = plan.approximations.unbounded()
    changed = with_rings(plan.tree, plan.approximated.take_leaves(), RINGS)
    wanted = np.intersect1d(unbounded, changed, assume_unique=True)
    if len(wanted):
        plan.approximations.put_along(wanted, _bounds(plan, wanted))
    return unbounded[plan.approximations.along(unbounded) > plan.request.limit]


def bounds_both_ways(plan: Plan, leaves: IndexArray) -> FloatArray:
    """(n,): of all leaves of a settled plan, how far each one's triangles are from the surface, and the surface from
    them: where places in a shell count, the surface over the leaves around may be the nearest."""
    found = plan.approximations.of(leaves).bounds
    around = largest_around(plan.tree, leaves, found)
    return np.where(np.isin(leaves, plan.approximations.unbounded()), around, found)


def largest_around(tree: Quadtree, leaves: IndexArray, values: FloatArray) -> FloatArray:
    """(n,): of some leaves the largest of the values (n,), not negative, of those of them that share a vertex."""
    slots, counts = tree.slots(leaves), tree.slot_counts(leaves)
    # Sides that are whole have no middle: what is written there is not read.
    vertices = np.concatenate([tree.slot_vertices[slots], tree.midpoints[tree.slot_edges[slots]]])
    at_vertices = np.zeros(len(tree.vertex_edges) + 1)
    np.maximum.at(at_vertices, vertices, np.tile(np.repeat(values, counts), 2))
    at_vertices[NONE] = 0.0
    starts = np.cumsum(counts) - counts
    found: FloatArray = np.maximum(*(np.maximum.reduceat(at_vertices[each], starts) for each in np.split(vertices, 2)))
    return found


def with_rings(tree: Quadtree, leaves: IndexArray, rings: int) -> IndexArray:
    """Some leaves, and so many rings of leaves around them, in ascending order."""
    for _ in range(rings):
        if len(leaves):
            around = np.flatnonzero(_faces_around(tree, leaves).take(tree.base_faces) & (tree.first_child == NONE))
            leaves = around[tree.share_a_vertex(around, leaves)]
    return leaves


def _faces_around(tree: Quadtree, nodes: IndexArray) -> BoolArray:
    """(faces of the control mesh,) those that share a vertex with a face of the nodes. All nodes that share a vertex
    with them lie on these."""
    mesh = tree.mesh
    marked = np.zeros(mesh.face_count, dtype=bool)
    marked[tree.base_faces[nodes]] = True
    at_vertices = np.zeros(mesh.vertex_count, dtype=bool)
    at_vertices[mesh.corner_vertices[marked.take(mesh.corner_faces)]] = True
    return any_of_slots(at_vertices.take(mesh.corner_vertices), mesh.face_sizes)


def _bounds(plan: Plan, wanted: IndexArray) -> FloatArray:
    """(n,): of some leaves, ascending; infinite beyond the limit."""
    tree, limit, approximations = plan.tree, plan.request.limit, plan.approximations
    near = with_rings(tree, wanted, 1)
    leaves = with_rings(tree, near, 1)
    drawn = LeafTriangles.of(plan, leaves, approximations.alone(leaves))
    # Of leaves that share a vertex with a wanted one all leaves around are here.
    is_whole = np.zeros(len(drawn.used), dtype=bool)
    is_whole[drawn.vertices[np.isin(leaves, near, assume_unique=True)[drawn.leaves]]] = True
    joined = drawn.joined(plan)
    bounded = approximations.alone(leaves).bounds[drawn.leaves]
    beyond = np.where(joined.is_closed, np.inf, bounded[np.where(joined.is_closed, 0, joined.across)])
    shell = Shell.of(joined, is_whole, limit)
    firsts, ends = (drawn.firsts[np.searchsorted(leaves, wanted) + end] for end in (0, 1))
    unusable = np.concatenate([[0], np.cumsum(shell.ranges <= 0)])
    found = np.where((ends > firsts) & (unusable[ends] == unusable[firsts]), 0.0, np.inf)
    left = np.flatnonzero(np.isfinite(found))
    for levels in TILE_LEVELS:
        in_shell = _InShell(shell, beyond, limit, len(left), plan.report)
        for some in chunks(len(left), LEAVES_AT_ONCE):
            for drawn_tiles in _tiles(plan, wanted[left[some]], levels):
                own = some.start + drawn_tiles.cells
                in_shell.include(drawn_tiles, own, firsts[left[own]] + drawn_tiles.firsts)
                plan.report()
        in_shell.finish()
        found[left] = np.maximum(in_shell.found, in_shell.of_rests)
        # Where only what was left at extraordinary vertices was too large, more levels leave less.
        left = left[np.isfinite(in_shell.found) & np.isinf(in_shell.of_rests)]
    # Places may be over triangles around that are drawn as polygons.
    found += largest_around(tree, leaves, approximations.alone(leaves).thickness)[np.searchsorted(leaves, wanted)]
    return np.where(found <= limit, found, np.inf)


def _tiles(plan: Plan, leaves: IndexArray, levels: int) -> Iterator[DrawnTiles]:
    """The surface over some leaves, ascending, with the index of the leaf in place of the cell: all bicubic tiles
    together, then the others."""
    tree, found = plan.tree, list[DrawnTiles]()
    for cells in in_blocks(plan.cells.of(leaves)):
        hanging = tree.hanging(tree.slots(cells.nodes))
        own = np.searchsorted(leaves, cells.nodes)
        drawn = cells.drawn_tiles(plan.approximations.alone(cells.nodes), hanging, levels)
        found += [replace(each, cells=own[each.cells]) for each in drawn]
    for are_bicubic, _, alike in _alike(found):
        tiles = joined_tiles([each.tiles for each in alike], are_bicubic)
        columns = ([getattr(each, name) for each in alike] for name in ("cells", "keys", "firsts"))
        yield DrawnTiles(tiles, *map(np.concatenate, columns))


def _alike(tiles: list[DrawnTiles]) -> Iterator[tuple[bool, int, list[DrawnTiles]]]:
    """Tiles with as many points each, those that are bicubic first."""

    def kind(each: DrawnTiles) -> tuple[bool, int]:
        return not each.tiles.are_bicubic, len(each.tiles.points)

    for (are_rests, count), alike in groupby(sorted(tiles, key=kind), key=kind):
        yield not are_rests, count, list(alike)


class _InShell:
    """Bounds of n leaves by pieces, collected and looked at together. found: (n,), of what can be divided; of_rests:
    (n,), of the rest."""

    def __init__(self, shell: Shell, beyond: FloatArray, limit: float, count: int, tick: Callable[[], None]) -> None:
        """beyond: as of ``shell_bounds``. tick: called meanwhile, and may raise to stop."""
        self._tick = tick
        self._shell, self._beyond, self._limit = shell, beyond, limit
        self.found, self.of_rests = np.zeros((2, count))
        self._waiting: defaultdict[tuple[int, int], list[tuple[IndexArray, Pieces, Form]]] = defaultdict(list)
        self._counts: Counter[tuple[int, int]] = Counter()

    def include(self, drawn: DrawnTiles, bases: IndexArray, firsts: IndexArray) -> None:
        """Tiles of leaves (P,). firsts: (P,), the triangle from which each one's are counted."""
        tiles, squares = drawn.tiles, drawn.tiles.squares
        over = over_triangles(drawn.keys, squares)
        for chosen, pieces, form in pieces_by_corners(self._shell, tiles, over, firsts):
            self._put(bases[chosen], pieces, form)
        cut = over.at(np.flatnonzero(over.shares == SOME if tiles.are_bicubic else over.shares != ALL))
        columns = (drawn.keys, squares.origins, squares.axes.reshape(-1, 4))
        for group, alike in grouped(cut.triangles, *(each[cut.tiles] for each in columns)):
            triangle, key, *place = group.tolist()
            chosen = cut.tiles[alike]
            for part in parts_of(int(key), int(triangle), tuple(place), are_bicubic=tiles.are_bicubic):
                triangles = firsts[chosen] + int(triangle)
                self._put(bases[chosen], pieces_over(self._shell, tiles, chosen, part, triangles), part.form)

    def _put(self, bases: IndexArray, pieces: Pieces, form: Form) -> None:
        key = id(form), len(pieces.hulls)
        self._waiting[key].append((bases, pieces, form))
        self._counts[key] += len(bases)
        if self._counts[key] >= MOST_PIECES:
            self._look_at(key)

    def finish(self) -> None:
        """Look at what is left."""
        for key in list(self._waiting):
            self._look_at(key)

    def _of(self, form: Form) -> FloatArray:
        return self.found if form.quarters else self.of_rests

    def _look_at(self, key: tuple[int, int]) -> None:
        self._counts[key] = 0
        waiting = self._waiting.pop(key)
        bases, form = np.concatenate([each[0] for each in waiting]), waiting[0][2]
        pieces, found = Pieces.joined([each[1] for each in waiting]), self._of(form)
        left = np.flatnonzero(np.isfinite(self.found[bases]) & np.isfinite(found[bases]))

        def look(some: IndexArray) -> tuple[IndexArray, FloatArray]:
            own, places = np.unique(bases[some], return_inverse=True)
            bounds = np.zeros(len(own))
            include_pieces(self._shell, bounds, places.reshape(-1), pieces.at(some), form, self._limit, self._beyond)
            return own, bounds

        for own, bounds in map_in_threads(look, index_chunks(left, PIECES_AT_ONCE), self._tick):
            found[own] = np.maximum(found[own], bounds)
