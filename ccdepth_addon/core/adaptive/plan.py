# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of an adaptive mesh: a tree, the surface over its nodes, and the triangles of its leaves."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import lengths, selected_vectors
from ..mesh.polygon_mesh import PolygonMesh
from ..progress import Progress
from ..tolerance.variation import ToleranceError
from .leaf_approximation import LeafApproximation, approximate_polygons, approximate_quads, ways_by_coefficients
from .node_surfaces import NodeSurfaces
from .quad_normals import are_narrow, better_diagonals, sampled_angles, ways_of_normals
from .rectangle_tree import ALONG_U, ALONG_V, NONE, QUARTERS, RectangleTree
from .request import AdaptiveRequest
from .rings import largest_around, with_rings
from .templates import WHOLE, template_numbers
from .varied_limits import VariedLimits
from .vertex_positions import VertexPositions

# A result is refused before planning when its estimated faces exceed the number allowed by this factor; and the least
# faces for a leaf there can be.
SURELY_TOO_MANY = 4
LEAST_FACES_OF_A_LEAF = 0.5

# The factor between the tolerances tried in search of one with few enough faces.
SEARCH_STEP = 1.1

# A part of the surface narrower than this many limits does not count for angles.
NARROW = 2.0

# The distances at samples decide how to split a leaf where the largest exceeds this part of the limit.
TELLING = 0.25


class TooManyFacesError(ValueError):
    """The error of a result with more faces than allowed. faces: their estimated number; tolerance: an estimate of a
    tolerance with few enough faces, in the unit of the positions, from the control mesh's faces alone."""

    def __init__(self, faces: int, tolerance: float) -> None:
        super().__init__(f"the result would have about {faces:,} faces; about {tolerance:.3g} might fit")
        self.faces = faces
        self.tolerance = tolerance


class Plan:
    """A tree, with the surfaces over its nodes and the positions of its vertices. Columns hold for each node: as a
    leaf, the template and the pattern of split sides; the bounds of ``leaf_bounds``: at equal parameters, by maps, and
    along the surface; and the bounds of ``leaf_angles``: of distances in pairs, and of the angles. limits: the largest
    distance allowed, the least over the node (docs/tolerance.md)."""

    def __init__(self, mesh: PolygonMesh, request: AdaptiveRequest, progress: Progress) -> None:
        """progress: receives the number of leaves so far, and may raise to stop."""
        self.request = request
        self._progress = progress
        self.tree = RectangleTree(mesh)
        self.surfaces = NodeSurfaces(self.tree)
        self.positions = VertexPositions(self.tree)
        self.limits = self.tree.add_column(np.float64(request.limit - request.rounding))
        varied = request.variation
        self._varied = None if varied is None else VariedLimits(self.tree, self.surfaces, request.limit, varied)
        self._vary_limits(np.arange(mesh.face_count))
        nothing = LeafApproximation.none(1)
        self._drawn = {field.name: self.tree.add_column(getattr(nothing, field.name)[0]) for field in fields(nothing)}
        self._split_sides = self.tree.add_column(np.int32(NONE))
        self.at_equal, self.mapped, self.along_surface, self.paired = (
            self.tree.add_column(np.float64(np.inf)) for _ in range(4)
        )
        self.shading, self.facets = (self.tree.add_column(np.float64(np.nan)) for _ in range(2))
        # Leaves with parts at semi-sharp edges that are too narrow to count.
        self.has_narrow = self.tree.add_column(np.bool_(False))
        # Leaves whose bound may have changed with the leaves around.
        self.is_stale = self.tree.add_column(np.bool_(False))
        self._changed = list[IndexArray]()
        self._split = list[IndexArray]()
        self._beside = list[IndexArray]()

    def report(self) -> None:
        """Report the number of leaves so far. Raises the caller's exception to stop."""
        self._progress(self.tree.leaf_count)

    def approximation(self, nodes: IndexArray) -> LeafApproximation:
        """The approximation of nodes."""
        return LeafApproximation(**{name: column.values.take(nodes) for name, column in self._drawn.items()})

    def bounds(self, leaves: IndexArray) -> FloatArray:
        """(n,): the proved distances of the triangles of leaves from the surface; infinite where none is proved."""
        columns = self.at_equal, self.mapped, self.along_surface, self.paired
        found: FloatArray = np.minimum.reduce([column.values[leaves] for column in columns])
        return found

    def limits_around(self, leaves: IndexArray, rings: int) -> FloatArray:
        """(n,): the least limits of leaves and of a number of rings of leaves around them."""
        if self.request.variation is None:
            return self.limits.values[leaves]
        near = with_rings(self.tree, leaves, rings)
        least = self.limits.values[near]
        for _ in range(rings):
            least = -largest_around(self.tree, near, -least)
        return least[np.searchsorted(near, leaves)]

    def reaches(self, leaves: IndexArray) -> FloatArray:
        """(n,): the widths below which parts of the surface over leaves are too narrow to count for angles."""
        return NARROW * self.limits.values[leaves]

    def _vary_limits(self, nodes: IndexArray) -> None:
        """Set the limits of nodes where the limit varies."""
        if self._varied is not None and len(nodes):
            limits = self._varied.of(nodes)
            self.limits.values[nodes] = limits - self.request.rounding
            if not np.all(limits > self.request.rounding):
                raise ToleranceError(
                    f"the tolerance is too fine somewhere: {limits.min():.3g}, where rounding takes "
                    f"{self.request.rounding:.3g}"
                )

    def angle_limits(self, leaves: IndexArray) -> FloatArray:
        """(2, n): the largest angles allowed of shading and of facets; infinite where none counts."""
        request, is_smooth = self.request, np.ones(len(leaves), dtype=bool)
        if request.is_smooth is not None:
            is_smooth = request.is_smooth[self.tree.base_faces[leaves]]
        shading = np.where(is_smooth & (request.shading > 0), request.shading, np.inf)
        return np.stack([shading, np.full(len(leaves), request.facets or np.inf)])

    def approximate(self, leaves: IndexArray) -> IndexArray:
        """Approximate leaves whose split sides have changed. Returns the leaves that miss more than the limit."""
        patterns = self._patterns(leaves)
        leaves = leaves[patterns != self._split_sides.values[leaves]]
        is_quad = self.tree.is_quad(leaves)
        for some, of_kind in ((leaves[is_quad], self._approximate_quads), (leaves[~is_quad], self._approximate_others)):
            for own in index_chunks(some, AT_ONCE):
                found = of_kind(own)
                for name, column in self._drawn.items():
                    column.values[own] = getattr(found, name)
                self.report()
        self._split_sides.values[leaves] = self._patterns(leaves)
        for column in (self.at_equal, self.mapped, self.along_surface, self.paired):
            column.values[leaves] = np.inf
        for column in (self.shading, self.facets):
            column.values[leaves] = np.nan
        self._changed.append(leaves)
        return leaves[~self._drawn["accepted"].values[leaves]]

    def take_changed(self) -> IndexArray:
        """The leaves approximated since the last call, each once, in ascending order."""
        changed, self._changed = self._leaves_among(self._changed), []
        return changed

    def _leaves_among(self, nodes: list[IndexArray]) -> IndexArray:
        is_there = np.zeros(len(self.tree.first_child), dtype=bool)
        for some in nodes:
            is_there[some] = True
        return np.flatnonzero(is_there & (self.tree.first_child == NONE))

    def _patterns(self, leaves: IndexArray) -> IndexArray:
        """(n,): the number of split sides of each leaf, enough to tell patterns apart, as sides are never joined
        again."""
        slots, counts = self.tree.slots(leaves), self.tree.slot_counts(leaves)
        found: IndexArray = np.add.reduceat(self.tree.hanging(slots), np.cumsum(counts) - counts, dtype=np.intp)
        return found

    def _approximate_quads(self, quads: IndexArray) -> LeafApproximation:
        tree, slots = self.tree, self.tree.quad_slots(quads).T
        points = self.surfaces.points(quads)
        self.positions.put(tree.slot_vertices[slots], points[:4])
        are_bicubic = self.surfaces.are_bicubic(quads)
        found = approximate_quads(
            points,
            tree.hanging(slots),
            self.are_border(tree.slot_edges[slots]),
            are_bicubic,
            self.limits.values[quads],
            self.request.axes,
        )
        if self.request.has_angles:
            self._consider_angles(quads, points, are_bicubic, found)
        return found if self.request.may_halve else replace(found, ways=np.full_like(found.ways, QUARTERS))

    def _consider_angles(
        self, quads: IndexArray, points: FloatArray, are_bicubic: BoolArray, found: LeafApproximation
    ) -> None:
        """Choose diagonals with smaller angles, and accept no bicubic quad with samples beyond an angle."""
        whole = np.flatnonzero(are_bicubic & found.accepted & (found.patterns == WHOLE))
        # The centre is no farther from the middle of either diagonal than the limit.
        off = points[8, whole] - (points[[0, 1]] + points[[2, 3]])[:, whole] / 2
        free = whole[(lengths(off) <= self.limits.values[quads[whole]]).all(axis=0)]
        found.alternatives[free] = better_diagonals(self.surfaces.coefficients(quads[free]))
        own = np.flatnonzero(are_bicubic & found.accepted)
        coefficients = self.surfaces.coefficients(quads[own])
        angles = sampled_angles(coefficients, template_numbers(found.patterns[own], found.alternatives[own]))
        missed = np.flatnonzero((angles > self.angle_limits(quads[own])).any(axis=0))
        missed = missed[~are_narrow(points[:4, own[missed]], self.reaches(quads[own[missed]]))]
        found.accepted[own[missed]] = False
        found.ways[own[missed]] = ways_of_normals(
            selected_vectors(coefficients, missed), self.request.shading or self.request.facets
        )

    def _approximate_others(self, faces: IndexArray) -> LeafApproximation:
        order, refinement = next(self.surfaces.refinements(faces))
        slots = self.tree.slots(faces[order])
        self.positions.put(self.tree.slot_vertices[slots], refinement.limits_at_corners)
        found = approximate_polygons(
            refinement, self.tree.hanging(slots), self.limits.values[faces[order]], self.request
        )
        return found.at(np.argsort(order))

    def are_border(self, edges: IndexArray) -> BoolArray:
        """Whether edges of the tree lie along control edges with one face, or with more than two."""
        edges = self.tree.base_edges.take(edges)
        found: BoolArray = (edges != NONE) & (self.tree.mesh.edge_face_counts[edges] != 2)
        return found

    def ways(self, leaves: IndexArray) -> IndexArray:
        """(n,): how to split leaves."""
        found: IndexArray = self._drawn["ways"].values[leaves].astype(np.intp)
        return found

    def ways_to_bounds(self, leaves: IndexArray) -> IndexArray:
        """(n,): how to split leaves for which no bound is proved. Where samples miss little across the planes, because
        parameters are uneven or lines wind within these planes, the largest second differences of coefficients decide.
        """
        ways = self.ways(leaves)
        missed = np.maximum(*(self._drawn[name].values[leaves] for name in ("along_u", "along_v")))
        is_unclear = (ways != QUARTERS) & (missed < TELLING * self.limits.values[leaves])
        for own in index_chunks(np.flatnonzero(is_unclear), AT_ONCE):
            ways[own] = ways_by_coefficients(self.surfaces.coefficients(leaves[own]))
        return ways

    def ways_by_sides(self, leaves: IndexArray) -> IndexArray:
        """(n,): how to split leaves across their longer sides."""
        ways = np.full(len(leaves), QUARTERS)
        if self.request.may_halve:
            is_quad = self.tree.is_quad(leaves)
            corners = self.positions.of(self.tree.slot_vertices[self.tree.quad_slots(leaves[is_quad])].ravel())
            corners = corners.reshape(-1, 4, 3)
            sides = lengths(np.roll(corners, -1, axis=1) - corners).reshape(-1, 2, 2).max(axis=1)
            ways[is_quad] = np.where(sides[:, 0] >= sides[:, 1], ALONG_U, ALONG_V)
        return ways

    def split(self, leaves: IndexArray, ways: IndexArray) -> IndexArray:
        """Split leaves, each once, in the given ways (n,). Bicubic quads are quartered by two halvings. Returns the
        children."""
        self._refuse_too_many(leaves)
        found = [np.zeros(0, dtype=np.intp)]
        is_bicubic = self.surfaces.are_bicubic(leaves)
        for way in (ALONG_U, ALONG_V):
            found.append(self._split_alike(leaves[is_bicubic & (ways == way)], way))
        twice = self._split_alike(leaves[is_bicubic & (ways == QUARTERS)], ALONG_U)
        found += [self._split_alike(twice, ALONG_V), self._split_alike(leaves[~is_bicubic], QUARTERS)]
        children = np.concatenate(found)
        self._vary_limits(children)
        return children

    def _split_alike(self, leaves: IndexArray, way: int) -> IndexArray:
        if not len(leaves):
            return leaves
        self.tree.split(leaves, way)
        self.surfaces.follow(leaves, way)
        self._split.append(leaves)
        self.report()
        children = self.tree.children(leaves)
        if self._varied is not None:
            counts = self.tree.slot_counts(leaves) if way == QUARTERS else np.full(len(leaves), 2)
            self._varied.inherit(np.repeat(leaves, counts), children)
        return children

    def take_beside_split(self) -> IndexArray:
        """The leaves beside those split since the last call, each once, in ascending order."""
        if not self._split:
            return np.zeros(0, dtype=np.intp)
        split, self._split = np.concatenate(self._split), []
        self._beside.append(self.tree.leaves_beside(split))
        return self._beside[-1]

    def approximate_beside_split(self) -> IndexArray:
        """Approximate the leaves that ``take_beside_split`` has returned since the last call, as in ``approximate``."""
        beside, self._beside = self._leaves_among(self._beside), []
        return self.approximate(beside)

    def leaves(self) -> IndexArray:
        """The leaves in the order of the control mesh's faces."""
        leaves = self.tree.leaves()
        return leaves[np.argsort(self.tree.base_faces[leaves], kind="stable")]

    def _refuse_too_many(self, unfinished: IndexArray) -> None:
        """Raise TooManyFacesError if splitting leaves makes too many, or if far too many are expected."""
        most = self.request.most_faces
        certain = self.tree.leaf_count + len(unfinished)
        expected = certain - 2 * len(unfinished) + self._expected(unfinished)
        if LEAST_FACES_OF_A_LEAF * certain > most or expected > SURELY_TOO_MANY * most:
            raise TooManyFacesError(int(expected), self._feasible_limit())

    def _expected(self, nodes: IndexArray, factor: float = 1.0) -> float:
        """The estimated number of leaves below nodes with their limits multiplied by a factor: each halving divides the
        error along its parameter by four."""
        limits = self.limits.values[nodes] * factor
        ratios = (self._drawn[name].values[nodes] / limits for name in ("along_u", "along_v"))
        halvings = sum(np.ceil(np.log2(np.maximum(each, 1.0)) / 2) for each in ratios)
        return float(np.exp2(halvings).sum())

    def _feasible_limit(self) -> float:
        """A limit with about as many faces as allowed; inf if the control mesh itself has more."""
        faces = np.arange(self.tree.mesh.face_count)
        if len(faces) > self.request.most_faces:
            return np.inf
        factor = 1.0
        while self._expected(faces, factor) > self.request.most_faces:
            factor *= SEARCH_STEP
        return factor * self.request.limit
