# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of leaves over flat parts of a control mesh (docs/adaptive.md, In a plane).

All leaves over a flat part are seen along its normal. Between them being off their sides costs nothing: what one leaf
lacks its neighbour has. What counts is the border of the part, where curves are off the sides of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays.ranges import ranges
from ..arrays.ranks import ranks_among_equal
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, squared_norms
from .flat_parts import THICKEST
from .leaf_bounds.leaf_distance import Hull, off_sides
from .plan import Plan
from .quadtree import NONE
from .request import AdaptiveRequest
from .tessellation import triangles_around

# A triangle counts whose least height is so many times as large as the part is thick: rounding cannot turn it round.
LEAST_HEIGHT = 16.0

# The grid for a search has so many cells for the square root of what is in it, and at most so many each way.
CELLS_EACH_WAY = 8
MOST_CELLS = 1024

# Rounding of a ratio.
ROUNDING = 1e-9


@dataclass(frozen=True)
class FlatBounds:
    """(leaves,) float64 each: upper bounds of the distance in both directions, inf where there are none; and what they
    would be if only the leaf's own sides were off the border."""

    bounds: FloatArray
    own: FloatArray

    @staticmethod
    def none(count: int) -> FlatBounds:
        return FlatBounds(np.full(count, np.inf), np.full(count, np.inf))

    def put(self, chosen: IndexArray, other: FlatBounds) -> None:
        """Replace some of them."""
        self.bounds[chosen], self.own[chosen] = other.bounds, other.own


def flat_bounds(plan: Plan, leaves: IndexArray) -> FlatBounds:
    """For leaves of the tree."""
    tree, flat = plan.tree, plan.flat_parts
    found = FlatBounds.none(len(leaves))
    if not len(leaves) or not len(flat.normals):
        return found
    parts = flat.parts[tree.base_faces[leaves]]
    everything = tree.leaves()
    of_all = flat.parts[tree.base_faces[everything]]
    for part in np.unique(parts[parts != NONE]).tolist():
        chosen = np.flatnonzero(parts == part)
        found.put(chosen, _bounds_of_part(plan, part, everything[of_all == part], leaves[chosen]))
    return found


def _bounds_of_part(plan: Plan, part: int, members: IndexArray, leaves: IndexArray) -> FlatBounds:
    """members: the leaves over the part; leaves: some of them."""
    normal, thickness = plan.flat_parts.normals[part], float(plan.flat_parts.thicknesses[part])
    members = members[_face_up(plan, members, normal, thickness)]
    found = FlatBounds.none(len(leaves))
    chosen = np.flatnonzero(np.isin(leaves, members))
    if len(chosen):
        frame = _frame(normal)
        border = _border(plan, members, _border_edges(plan, members), frame)
        near = _near_border(plan, leaves[chosen], border, frame, thickness)
        # The polygons are so far from the triangles that the bounds are of.
        of_polygons = plan.approximations.thickness[members].max()
        found.put(chosen, FlatBounds(near.bounds + of_polygons, near.own + of_polygons))
    return found


def _face_up(plan: Plan, members: IndexArray, normal: FloatArray, thickness: float) -> BoolArray:
    """(members,): the leaves all of whose triangles go round counter-clockwise, seen along the normal, and surely. For
    polygons that are thin enough these lie around the mean of their corners."""
    tree, approximation = plan.tree, plan.approximations.without_neighbours(members)
    drawn = triangles_around(tree, members, approximation, plan.request.transitions)
    found = np.zeros(len(members), dtype=bool)
    found[drawn.leaves] = True
    allowed = LEAST_HEIGHT * (thickness + plan.request.rounding)
    found[drawn.leaves[~_turn_left(plan.positions.of(drawn.used)[drawn.corners], normal, allowed)]] = False
    for vertices, leaves in drawn.polygons:
        corners = tree.slot_vertices[tree.slots(members[leaves])].reshape(len(leaves), -1)
        around, corners = (plan.positions.of(own.ravel()).reshape(*own.shape, 3) for own in (vertices, corners))
        middle = np.broadcast_to(corners.mean(axis=1, keepdims=True), around.shape)
        triangles = np.stack([around, np.roll(around, -1, axis=1), middle], axis=2)
        fine = _turn_left(triangles.reshape(-1, 3, 3), normal, allowed).reshape(vertices.shape).all(axis=1)
        found[leaves] = fine & (approximation.thickness[leaves] <= THICKEST * plan.request.limit)
    return found


def _turn_left(triangles: FloatArray, normal: FloatArray, height: float) -> BoolArray:
    """(T,): whether triangles (T, 3, 3) go round counter-clockwise, seen along the normal, and are higher than some
    height."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    areas = cross_products(sides[:, 0], sides[:, 1]) @ normal
    return np.asarray(areas > height * np.sqrt(squared_norms(sides).max(axis=1)))


def _sides(plan: Plan, members: IndexArray) -> tuple[IndexArray, IndexArray]:
    """The edges along the leaves' sides, halves where these are split, and 1 or -1 for the way a leaf goes along it."""
    tree = plan.tree
    slots = tree.slots(members)
    edges = tree.slot_edges[slots]
    ways = np.where(tree.edge_vertices[edges, 0] == tree.slot_vertices[slots], 1, -1)
    halves = tree.edge_children[edges]
    split = np.flatnonzero(halves != NONE)
    whole = np.flatnonzero(halves == NONE)
    found = np.concatenate([edges[whole], halves[split], halves[split] + 1])
    return found, np.concatenate([ways[whole], ways[split], ways[split]])


def _border_edges(plan: Plan, members: IndexArray) -> BoolArray:
    """(edges of the tree,): those along which leaves do not cancel."""
    edges, ways = _sides(plan, members)
    sums = np.zeros(len(plan.tree.edge_vertices), dtype=np.intp)
    np.add.at(sums, edges, ways)
    return sums != 0


def _frame(normal: FloatArray) -> FloatArray:
    """(2, 3): unit vectors across it."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.sqrt(first @ first)
    return np.stack([first, np.cross(normal, first)])


@dataclass(frozen=True)
class _Border:
    """B sides of triangles along the border, seen in the plane: from starts to ends (B, 2), the leaves on their left
    (B,); and (B,) how far the curves are off these sides at most."""

    starts: FloatArray
    ends: FloatArray
    leaves: IndexArray
    off: FloatArray

    def boxes(self) -> tuple[FloatArray, FloatArray]:
        """(B, 2) twice: the lowest and the highest coordinates of what lies between curves and sides."""
        room = self.off[:, None]
        return np.minimum(self.starts, self.ends) - room, np.maximum(self.starts, self.ends) + room

    def lengths(self) -> FloatArray:
        """(B,): of the sides."""
        return _lengths(self.ends - self.starts)

    def inward(self) -> FloatArray:
        """(B, 2): unit vectors to the left; 0 where a side has no length."""
        along, lengths = self.ends - self.starts, self.lengths()
        return np.stack([-along[:, 1], along[:, 0]], axis=1) / np.where(lengths > 0, lengths, 1.0)[:, None]


def _border(plan: Plan, members: IndexArray, is_border: BoolArray, frame: FloatArray) -> _Border:
    tree = plan.tree
    slots, counts = tree.slots(members), tree.slot_counts(members)
    edges = tree.slot_edges[slots]
    halves = tree.edge_children[edges]
    along = np.where(halves == NONE, is_border[edges], is_border[halves] | is_border[halves + 1])
    at_border = members[np.logical_or.reduceat(along, np.cumsum(counts) - counts)]
    starts, stops, owners, off = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    for block in plan.outlines.of(at_border, plan.request.limit):
        outline, slots = block.outline, block.slots
        for side in off_sides(outline, block.hull):
            own, following = slots[side.number], slots[(side.number + 1) % len(slots)]
            ends = own if side.is_first else following
            edges = tree.slot_edges[own] if side.is_whole else tree.half_at(own, ends)
            border = np.flatnonzero(is_border[edges])
            starts.append(outline.points[side.start][border] @ frame.T)
            stops.append(outline.points[side.end][border] @ frame.T)
            owners.append(block.nodes[border])
            off.append(side.off[border] + plan.request.rounding)
    return _Border(np.concatenate(starts), np.concatenate(stops), np.concatenate(owners), np.concatenate(off))


def _near_border(plan: Plan, leaves: IndexArray, border: _Border, frame: FloatArray, thickness: float) -> FlatBounds:
    """For some of the leaves over a flat part."""
    grid, flat, faces = _Grid.of(border), plan.flat_parts, plan.tree.base_faces[leaves]
    nodes_found = FlatBounds.none(len(plan.tree.first_child))
    thickness += plan.request.rounding
    centres, radii = flat.centres[faces] @ frame.T, flat.radii[faces, None] + plan.request.rounding
    far = leaves[~grid.meets(centres - radii, centres + radii)]
    nodes_found.put(far, FlatBounds(np.full(len(far), thickness), np.full(len(far), thickness)))
    off_own = np.zeros(len(plan.tree.first_child))
    np.maximum.at(off_own, border.leaves, border.off)
    for block in plan.outlines.of(np.setdiff1d(leaves, far), plan.request.limit):
        nodes, outline = block.nodes, block.outline
        points = outline.points[[start for start, *_ in outline.sides()]] @ frame.T
        beyond = _beyond_border(points, block.hull, border, grid, frame, plan.request)
        from_surface = np.hypot(beyond, thickness)
        near = np.hypot(grid.most_off(points.min(axis=0), points.max(axis=0)), thickness)
        bounds, own = np.maximum(from_surface, near), np.maximum(from_surface, np.hypot(off_own[nodes], thickness))
        nodes_found.put(nodes, FlatBounds(bounds * (1 + ROUNDING), own * (1 + ROUNDING)))
    return FlatBounds(nodes_found.bounds[leaves], nodes_found.own[leaves])


# Where a side has no length there is no line to be beyond.
@np.errstate(divide="ignore", invalid="ignore")
def _beyond_border(
    points: FloatArray, hull: Hull, border: _Border, grid: _Grid, frame: FloatArray, request: AdaptiveRequest
) -> FloatArray:
    """(P,): how far the surface over leaves with vertices (V, P, 2) around them is from what all triangles of the part
    cover at most, as seen in the plane; inf if farther than the limit, or if a leaf does not go round its middle."""
    seen, reach = hull.points @ frame.T, hull.reach()
    middle = points.mean(axis=0)
    room = (request.limit + reach)[:, None]
    lows = np.minimum(seen.min(axis=0) - room, points.min(axis=0))
    highs = np.maximum(seen.max(axis=0) + room, points.max(axis=0))
    leaves, sides = grid.pairs(lows, highs)
    inward, starts = border.inward()[sides], border.starts[sides]
    # What rounding may turn and shift a line, within the box.
    farthest = _lengths(np.maximum(middle - lows, highs - middle))[leaves] + _lengths(middle[leaves] - starts)
    slack = request.rounding * (1 + farthest / border.lengths()[sides])
    depths = ((middle[leaves] - starts) * inward).sum(axis=1) - slack
    # In each round a leaf occurs once.
    ranks = ranks_among_equal(leaves)
    rounds = [np.flatnonzero(ranks == rank) for rank in range(int(ranks.max(initial=-1)) + 1)]
    # Onto the line that is passed by most, and from there towards the middle of the leaf.
    over = np.zeros(seen.shape[:2])
    way = np.zeros_like(seen)
    for chosen in rounds:
        own = leaves[chosen]
        past = ((starts[chosen] - seen[:, own]) * inward[chosen]).sum(axis=2) + reach[own] + slack[chosen]
        worse = past > over[:, own]
        over[:, own] = np.where(worse, past, over[:, own])
        way[:, own] = np.where(worse[..., None], inward[chosen], way[:, own])
    moved = seen + over[..., None] * way
    part = np.zeros(seen.shape[:2])
    for chosen in rounds:
        own = leaves[chosen]
        past = ((starts[chosen] - moved[:, own]) * inward[chosen]).sum(axis=2) + reach[own] + slack[chosen]
        past = np.maximum(past, 0.0)
        part[:, own] = np.maximum(part[:, own], past / (past + depths[chosen]))
    # The surface is off hull points by so much: as far past lines, and as much farther from the middle.
    distances = (over + part * (_lengths(moved - middle) + reach + request.rounding)).max(axis=0)
    distances *= 1 + ROUNDING
    distances[leaves[~(depths > 0)]] = np.inf
    along, off = np.roll(points, -1, axis=0) - points, middle - points
    turns = along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0]
    distances[np.any(turns <= 2 * request.rounding * (_lengths(along) + _lengths(off)), axis=0)] = np.inf
    return np.where(distances <= request.limit, distances, np.inf)


def _lengths(vectors: FloatArray) -> FloatArray:
    """(…): of vectors (…, 2)."""
    return np.hypot(vectors[..., 0], vectors[..., 1])


@dataclass(frozen=True)
class _Grid:
    """The boxes of a border by the cells of a grid that they meet. counts: (n + 1, n + 1) how many cells before each
    hold something; most: (n, n) the largest of what is off there, or -inf. cells and boxes: which cells meet which
    boxes, in the order of the cells."""

    origin: FloatArray
    steps: FloatArray
    counts: IndexArray
    most: FloatArray
    cells: IndexArray
    boxes: IndexArray

    @staticmethod
    def of(border: _Border) -> _Grid:
        size = int(min(MOST_CELLS, max(1.0, np.ceil(CELLS_EACH_WAY * np.sqrt(len(border.off))))))
        lows, highs = border.boxes()
        origin = lows.min(axis=0) if len(lows) else np.zeros(2)
        end = highs.max(axis=0) if len(highs) else np.ones(2)
        steps = np.maximum((end - origin) / size, np.finfo(float).tiny)
        most, nothing = np.full((size, size), -np.inf), np.zeros(0, dtype=np.intp)
        empty = _Grid(origin, steps, np.zeros((size + 1, size + 1), dtype=np.intp), most, nothing, nothing)
        boxes, cells = _cells_of(*empty._ranges(lows, highs), size)
        np.maximum.at(most.reshape(-1), cells, border.off[boxes])
        empty.counts[1:, 1:] = np.cumsum(np.cumsum(most > -np.inf, axis=0), axis=1)
        order = np.argsort(cells, kind="stable")
        return replace(empty, cells=cells[order], boxes=boxes[order])

    def pairs(self, lows: FloatArray, highs: FloatArray) -> tuple[IndexArray, IndexArray]:
        """(N,) twice: which boxes may meet which of the border, each pair once."""
        near = np.flatnonzero(self.meets(lows, highs))
        own, cells = _cells_of(*self._ranges(lows[near], highs[near]), len(self.most))
        first, last = (np.searchsorted(self.cells, cells, side) for side in ("left", "right"))
        counts = last - first
        others = self.boxes[ranges(first, counts)]
        size = int(self.boxes.max(initial=0)) + 1
        found, others = np.divmod(np.unique(np.repeat(near[own], counts) * size + others), size)
        return found, others

    def _ranges(self, lows: FloatArray, highs: FloatArray) -> tuple[IndexArray, IndexArray]:
        """(N, 2) twice: the first cells that boxes meet, and those after the last. A cell more on each side, as
        rounding may be off by one."""
        with np.errstate(invalid="ignore", over="ignore"):
            first, last = (np.floor((corner - self.origin) / self.steps) for corner in (lows, highs))
        size = len(self.most)
        first = np.clip(np.nan_to_num(first, nan=0.0) - 1, 0, size).astype(np.intp)
        return first, np.clip(np.nan_to_num(last, nan=size) + 2, 0, size).astype(np.intp)

    def meets(self, lows: FloatArray, highs: FloatArray) -> BoolArray:
        """(N,): whether boxes (N, 2) may meet one of the border."""
        (i, j), (k, m) = (corner.T for corner in self._ranges(lows, highs))
        k, m = np.maximum(i, k), np.maximum(j, m)
        counts = self.counts
        return np.asarray(counts[k, m] - counts[i, m] - counts[k, j] + counts[i, j] > 0)

    def most_off(self, lows: FloatArray, highs: FloatArray) -> FloatArray:
        """(N,): what is off at most along those that boxes (N, 2) may meet; 0 where there are none."""
        found = np.zeros(len(lows))
        near = np.flatnonzero(self.meets(lows, highs))
        boxes, cells = _cells_of(*self._ranges(lows[near], highs[near]), len(self.most))
        np.maximum.at(found, near[boxes], self.most.reshape(-1)[cells])
        return found


def _cells_of(first: IndexArray, last: IndexArray, size: int) -> tuple[IndexArray, IndexArray]:
    """Boxes of cells (N, 2), from the first to before the last, cell by cell: which box, and which cell."""
    rows, columns = np.maximum(last - first, 0).T
    counts = rows * columns
    boxes = np.repeat(np.arange(len(counts)), counts)
    row, column = np.divmod(ranges(np.zeros_like(counts), counts), columns[boxes])
    return boxes, (first[boxes, 0] + row) * size + first[boxes, 1] + column
