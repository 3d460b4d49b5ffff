# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of the distance between the drawn triangles of leaves and the surface.

A bicubic leaf within the limit at equal parameters has that bound, and otherwise a bound by a map onto its own
triangles (``template_maps``). All other leaves have bounds by places in a shell (docs/distance.md, Shells), independent
of parameters. A leaf that is not bicubic and has no places is compared at equal parameters after all. A leaf compared
with its own surface, at equal parameters or by a map, has to be within its own limit; any other leaf has to be within
the least limit of the leaves around, as its triangles may be near their surface (docs/tolerance.md).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from itertools import groupby

import numpy as np

from ..arrays.chunks import chunks, index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..distance.leaf_surfaces import Tiles, tiles_of
from ..distance.piece_hulls import Pieces
from ..distance.pieces import Form, include_at_equal, include_pieces
from ..distance.shells import Shell
from ..distance.side_bounds import Beside
from ..surface.squares import Squares
from .leaf_approximation import LeafApproximation
from .leaf_triangles import LeafTriangles
from .plan import Plan
from .rings import largest_around, with_rings
from .surface_pieces import DrawnTiles, half_keys, pieces_of_tiles, quarter_keys
from .template_maps import template_maps
from .template_rows import bounds_at_equal
from .templates import template_numbers

# The number of rings of leaves on which a bound depends: the triangles of the first ring, and through the vectors at
# their vertices the triangles of the second.
RINGS = 2

# The levels of tiles around extraordinary vertices; more where the rest is too large.
TILE_LEVELS = (3, 6, 14)

# The number of pieces bounded together, and the largest number in memory at once.
PIECES_AT_ONCE, MOST_PIECES = 1 << 13, 1 << 15

# The number of leaves whose tiles are made together, and of leaves compared at equal parameters together.
LEAVES_AT_ONCE, FEW_LEAVES_AT_ONCE, MAPPED_AT_ONCE = 1 << 14, 1 << 11, 1 << 9

# Raises the bounds found (n,) to the bounds of pieces of a form, by the bases (P,) of pieces; infinite beyond the
# limits (n,).
Include = Callable[[FloatArray, IndexArray, Pieces, Form, FloatArray], None]


def unbounded(plan: Plan) -> IndexArray:
    """The leaves without a bound within the limit: among the changed leaves, or if there are none, among the leaves
    whose bounds may have changed with the leaves around."""
    changed = plan.take_changed()
    if not plan.request.has_angles:
        bound_at_equal(plan, changed)
    _bound_by_maps(plan, changed)
    plan.is_stale.values[with_rings(plan.tree, changed, RINGS)] = True
    if len(failed := _bound_stale(plan, changed)):
        return failed
    while True:
        failed = _bound_stale(plan, plan.tree.leaves())
        if len(failed) or not np.any(plan.is_stale.values[plan.tree.leaves()]):
            return failed


def _bound_stale(plan: Plan, leaves: IndexArray) -> IndexArray:
    """Bound the stale leaves among some, ascending. Returns the leaves without a bound within the limit."""
    stale = leaves[plan.is_stale.values[leaves]]
    wanted = stale[np.isinf(plan.at_equal.values[stale]) & np.isinf(plan.mapped.values[stale])]
    if plan.request.has_angles:
        # Leaves paired with their own triangles need no other bound, but for the leaves around that do.
        every = plan.tree.leaves()
        around = with_rings(plan.tree, every[np.isinf(plan.paired.values[every])], 1)
        wanted = np.intersect1d(wanted, around, assume_unique=True)
    plan.is_stale.values[stale] = False
    plan.along_surface.values[wanted] = _bounds_along_surface(plan, wanted)
    failed = wanted[np.isinf(plan.along_surface.values[wanted])]
    others = failed[~plan.surfaces.are_bicubic(failed)]
    if len(others):
        bounds = _irregular_at_equal(plan, others)
        within = bounds <= plan.limits.values[others]
        plan.at_equal.values[others[within]] = bounds[within]
        # Their neighbours are then bounded as beside a comparison at equal parameters.
        plan.is_stale.values[with_rings(plan.tree, others[within], RINGS)] = True
        failed = np.setdiff1d(failed, others[within])
    return failed


def bounds_both_ways(plan: Plan, leaves: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(n,) twice: for each leaf of a settled plan, the bound of the distance between its triangles and the surface,
    both ways, and its largest ratio to the tolerance at the surface. For places in a shell the bounds of the leaves
    around are included, as their surface may be the nearest."""
    found, rounding = plan.bounds(leaves), plan.request.rounding
    is_own = np.isfinite(np.minimum.reduce([each.values[leaves] for each in (plan.at_equal, plan.mapped, plan.paired)]))
    limits = np.where(is_own, plan.limits.values[leaves], plan.limits_around(leaves, 1))
    ratios = (found + rounding) / (limits + rounding)
    around = [largest_around(plan.tree, leaves, each) for each in (found, ratios)]
    return np.where(is_own, found, around[0]), np.where(is_own, ratios, around[1])


def bound_at_equal(plan: Plan, leaves: IndexArray) -> None:
    """Bound the bicubic leaves among some at equal parameters."""
    for some in index_chunks(leaves[plan.surfaces.are_bicubic(leaves)], FEW_LEAVES_AT_ONCE):
        drawn, limits = plan.approximation(some), plan.limits.values[some]
        numbers = template_numbers(drawn.patterns, drawn.alternatives)
        bounds = bounds_at_equal(plan.surfaces.coefficients(some), numbers, limits)
        plan.at_equal.values[some] = np.where(bounds <= limits, bounds, np.inf)
        plan.report()


def _bound_by_maps(plan: Plan, leaves: IndexArray) -> None:
    """Bound the bicubic leaves among some without a bound at equal parameters by maps onto their own triangles."""
    leaves = leaves[np.isinf(plan.at_equal.values[leaves]) & plan.surfaces.are_bicubic(leaves)]
    for some in index_chunks(leaves, MAPPED_AT_ONCE):
        drawn = plan.approximation(some)
        numbers = template_numbers(drawn.patterns, drawn.alternatives)
        plan.mapped.values[some] = template_maps(plan.surfaces.coefficients(some), numbers, plan.limits.values[some])
        plan.report()


def _irregular_at_equal(plan: Plan, leaves: IndexArray) -> FloatArray:
    """(n,): the bounds at equal parameters of leaves that are not bicubic, ascending."""
    drawn = plan.approximation(leaves)
    triangles = LeafTriangles.of(plan, leaves, drawn)
    limits = plan.limits.values[leaves]
    found = _by_pieces(plan, leaves, triangles.corners(plan), triangles.firsts[:-1], include_at_equal, limits)
    return found + drawn.thickness


def _bounds_along_surface(plan: Plan, wanted: IndexArray) -> FloatArray:
    """(n,): the bounds of leaves, ascending, by places in a shell; infinite beyond the least limit
    around."""
    if not len(wanted):
        return np.zeros(0)
    tree, limits = plan.tree, plan.limits_around(wanted, 2)
    near = with_rings(tree, wanted, 1)
    leaves = with_rings(tree, near, 1)
    approximation = plan.approximation(leaves)
    drawn = LeafTriangles.of(plan, leaves, approximation)
    # The leaves around every leaf that shares a vertex with a wanted leaf are all included.
    is_whole = np.zeros(len(drawn.used), dtype=bool)
    is_whole[drawn.vertices[np.isin(leaves, near, assume_unique=True)[drawn.leaves]]] = True
    joined = drawn.joined(plan)
    at_equal, is_mapped = (
        plan.at_equal.values[leaves][drawn.leaves],
        np.isfinite(plan.mapped.values[leaves])[drawn.leaves],
    )
    across = np.where(joined.is_closed, 0, joined.across)
    beside = Beside(np.where(joined.is_closed, np.inf, at_equal[across]), ~joined.is_closed & is_mapped[across])
    shell = Shell.of(joined, is_whole, plan.limits.values[leaves][drawn.leaves])
    firsts, ends = (drawn.firsts[np.searchsorted(leaves, wanted) + end] for end in (0, 1))
    unusable = np.concatenate([[0], np.cumsum(shell.ranges <= 0)])
    usable = np.flatnonzero((ends > firsts) & (unusable[ends] == unusable[firsts]))

    def include(found: FloatArray, bases: IndexArray, pieces: Pieces, form: Form, limits: FloatArray) -> None:
        include_pieces(found, bases, pieces, form, limits, shell, beside)

    found = np.full(len(wanted), np.inf)
    found[usable] = _by_pieces(plan, wanted[usable], shell.triangles.corners, firsts[usable], include, limits[usable])
    # Places may be over neighbours that are drawn as polygons.
    found += largest_around(tree, leaves, approximation.thickness)[np.searchsorted(leaves, wanted)]
    return np.where(found <= limits, found, np.inf)


def _by_pieces(
    plan: Plan, leaves: IndexArray, corners: FloatArray, firsts: IndexArray, include: Include, limits: FloatArray
) -> FloatArray:
    """(n,): the bounds of leaves, ascending, by all pieces of their surface. corners: (M, 3, 3), of triangles; firsts:
    (n,), the first triangle of each leaf; limits: (n,), of the bounds."""
    (found, of_tiles), left, before = np.zeros((2, len(leaves))), np.arange(len(leaves)), 0
    for levels in TILE_LEVELS:
        waiting = _Waiting(corners, limits[left], include, plan.report)
        for some in chunks(len(left), LEAVES_AT_ONCE):
            for drawn in joined_by_points(drawn_tiles(plan, leaves[left[some]], levels)):
                # The bicubic tiles of earlier levels are already bounded.
                if before and drawn.tiles.are_bicubic:
                    drawn = drawn.at(np.flatnonzero(drawn.tiles.squares.sizes() < 2.0**-before))
                own = some.start + drawn.leaves
                waiting.put(drawn, own, firsts[left[own]] + drawn.firsts)
                plan.report()
        waiting.finish()
        of_tiles[left] = np.maximum(of_tiles[left], waiting.found)
        found[left] = np.maximum(of_tiles[left], waiting.of_rests)
        # Where only the rest at extraordinary vertices was too large, more levels make the rest smaller.
        left = left[np.isfinite(waiting.found) & np.isinf(waiting.of_rests)]
        if not len(left):
            break
        before = levels
    return found


def drawn_tiles(plan: Plan, leaves: IndexArray, levels: int) -> Iterator[DrawnTiles]:
    """The tiles of the whole surface over leaves, ascending, with the drawn triangles below them. levels: of tiles
    around extraordinary vertices."""
    tree, drawn = plan.tree, plan.approximation(leaves)
    is_quad = tree.is_quad(leaves)
    is_bicubic = plan.surfaces.are_bicubic(leaves)
    numbers = template_numbers(drawn.patterns, drawn.alternatives)
    if len(own := np.flatnonzero(is_bicubic)):
        tiles = Tiles(Squares.whole(len(own)), plan.surfaces.coefficients(leaves[own]))
        yield DrawnTiles(tiles, own, numbers[own], np.zeros_like(own))
    others = np.flatnonzero(is_quad & ~is_bicubic)
    for places, refinement in plan.surfaces.refinements(leaves[others]):
        for tiles in tiles_of(refinement, levels):
            own = others[places[tiles.squares.bases]]
            yield DrawnTiles(tiles, own, numbers[own], np.zeros_like(own))
    others = np.flatnonzero(~is_quad)
    for places, refinement in plan.surfaces.refinements(leaves[others]):
        own = others[places]
        is_split = tree.hanging(tree.slots(leaves[own]))
        for tiles in tiles_of(refinement.refined().numbered(), levels):
            for of_kind in _over_quarters(tiles, drawn.at(own), is_split, tree.slot_counts(leaves[own])):
                yield DrawnTiles(of_kind.tiles, own[of_kind.leaves], of_kind.keys, of_kind.firsts)


def _over_quarters(
    tiles: Tiles, drawn: LeafApproximation, is_split: BoolArray, sizes: IndexArray
) -> Iterator[DrawnTiles]:
    """The tiles over quarters of faces other than quads: over the template of a triangle, or over halves of quarters,
    cut from corner to centroid. is_split: (C,) bool, the split sides, face by face."""
    quarters, starts = tiles.squares.bases, np.cumsum(sizes) - sizes
    faces = np.repeat(np.arange(len(sizes)), sizes)
    are_polygons = (sizes > 3)[faces[quarters]]
    own = np.flatnonzero(~are_polygons)
    if len(own):
        some = faces[quarters[own]]
        keys = quarter_keys(drawn.patterns[some].astype(np.intp), quarters[own] - starts[some])
        yield DrawnTiles(tiles.at(own), some, keys, np.zeros_like(own))
    own = np.flatnonzero(are_polygons)
    if not len(own):
        return
    before = np.arange(len(faces)) - 1
    before[starts] = starts + sizes - 1
    counts = np.where(is_split, 2, 1)
    firsts = np.cumsum(counts) - counts
    firsts -= firsts[starts][faces]
    lasts = np.where(firsts == 0, np.add.reduceat(counts, starts)[faces], firsts) - 1
    for keys, first in ((half_keys(False, is_split), firsts), (half_keys(True, is_split[before]), lasts)):
        some = quarters[own]
        yield DrawnTiles(tiles.at(own), faces[some], keys[some], first[some])


def joined_by_points(tiles: Iterator[DrawnTiles]) -> Iterator[DrawnTiles]:
    """The tiles joined by their number of points, bicubic tiles first."""

    def kind(each: DrawnTiles) -> tuple[bool, int]:
        return not each.tiles.are_bicubic, len(each.tiles.points)

    for _, (first, *others) in groupby(sorted(tiles, key=kind), key=kind):
        yield first.joined(others)


class _Waiting:
    """The pieces of n leaves, collected and bounded together. found: (n,), the bounds of pieces that can be divided;
    of_rests: (n,), the bounds of all other pieces."""

    def __init__(self, corners: FloatArray, limits: FloatArray, include: Include, tick: Callable[[], None]) -> None:
        """An empty collection. corners: (M, 3, 3), of triangles; limits: (n,), of leaves. tick: called meanwhile, and
        may raise to stop."""
        self._corners, self._limits, self._include, self._tick = corners, limits, include, tick
        self.found, self.of_rests = np.zeros((2, len(limits)))
        self._waiting: defaultdict[tuple[int, int], list[tuple[IndexArray, Pieces, Form]]] = defaultdict(list)
        self._counts: Counter[tuple[int, int]] = Counter()

    def put(self, drawn: DrawnTiles, leaves: IndexArray, firsts: IndexArray) -> None:
        """Add tiles of leaves (P,). firsts: (P,), the first triangle of each tile's leaf."""
        for chosen, pieces, form in pieces_of_tiles(self._corners, drawn, firsts):
            self._put(leaves[chosen], pieces, form)

    def _put(self, leaves: IndexArray, pieces: Pieces, form: Form) -> None:
        key = id(form), len(pieces.hulls)
        self._waiting[key].append((leaves, pieces, form))
        self._counts[key] += len(leaves)
        if self._counts[key] >= MOST_PIECES:
            self._look_at(key)

    def finish(self) -> None:
        """Bound the pieces still waiting."""
        for key in list(self._waiting):
            self._look_at(key)

    def _look_at(self, key: tuple[int, int]) -> None:
        self._counts[key] = 0
        waiting = self._waiting.pop(key)
        of_leaves, (first, *others), (form, *_) = zip(*waiting, strict=True)
        leaves, pieces = np.concatenate(of_leaves), first.joined(others)
        found = self.found if form.quarters else self.of_rests
        left = np.flatnonzero(np.isfinite(self.found[leaves]) & np.isfinite(found[leaves]))

        def look(some: IndexArray) -> tuple[IndexArray, FloatArray]:
            own, places = np.unique(leaves[some], return_inverse=True)
            bounds = np.zeros(len(own))
            self._include(bounds, places.reshape(-1), pieces.at(some), form, self._limits[own])
            return own, bounds

        for own, bounds in map_in_threads(look, index_chunks(left, PIECES_AT_ONCE), self._tick):
            found[own] = np.maximum(found[own], bounds)
