# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit surface as Bézier pieces that can be split, down to any size.

The control mesh is subdivided to *units*, quads of one level. A regular unit is a bicubic patch, exactly. Any other
piece has an *excess*, a bound of its distance from the surface at equal parameters. Near an extraordinary vertex the
piece is bicubic (``extraordinary_pieces``); any other piece is refined, and until then has the bilinear facet over its
corners' limit positions for coefficients (``norm_bounds.support_bounds``). Corners of all pieces lie on the surface.
docs/deviation.md, Pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks, index_chunks
from ..arrays.column import Column
from ..arrays.ranges import ranges
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices, support_bounds
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import faces_alone
from ..surface.bicubic import HALVES, NET_TO_BERNSTEIN
from ..surface.catmull_clark import subdivide
from ..surface.patches import classify_patches, extraordinary_nets, regular_nets
from ..surface.refinement import Refinement
from ..surface.stencils import by_valence
from .extraordinary_pieces import children_of_nets, pieces_of_nets
from .piece_factors import PieceFactors
from .spread import NONE

# Coefficients along the sides, from each corner to the next.
SIDES = np.array([[0, 4, 8, 12], [12, 13, 14, 15], [15, 11, 7, 3], [3, 2, 1, 0]])

# Weights of the coefficients at the middle of a piece.
MIDDLE = np.kron([1, 3, 3, 1], [1, 3, 3, 1]) / 64

# Corner 0 of the quarters lies at (0, 0), (½, 0), (0, ½), (½, ½) of a piece; which of their sides lie on its own.
QUARTER_SIDES = np.array([[1, 0, 0, 1], [1, 1, 0, 0], [0, 0, 1, 1], [0, 1, 1, 0]], dtype=bool)
QUARTERS = np.stack([np.kron(along, across) for across in HALVES for along in HALVES])

# Vertices of larger valence have no matrices, which take time proportional to the valence's cube.
LARGEST_VALENCE = 1 << 10


@dataclass(frozen=True)
class NewPieces:
    """N pieces, see ``BezierPieces``; stores, rows: (N,) intp, the nets or the refinement with the points of each
    piece, and the piece's index there; NONE where the piece is the surface. turned: (N,) intp, the corner of its face
    from which the corners of each are counted."""

    coefficients: FloatArray
    middles: FloatArray
    excess: FloatArray
    sides: IndexArray
    stores: IndexArray
    rows: IndexArray
    turned: IndexArray


@dataclass(frozen=True)
class Nets:
    """The nets of extraordinary patches of one valence n: (2n + 8, P, 3), in Stam's order."""

    valence: int
    nets: FloatArray


class BezierPieces:
    """All pieces, past ones included: parents keep their place, and their four children follow each other.

    coefficients: (N, 3, 16) float64, Bernstein; excess: (N,) float64, bounds of the surface's distance at equal
    parameters. middles: (N, 3) float64, the middle of the surface, or of the piece if ``is_bilinear``. faces, units:
    (N,) intp, the control face and the unit of each piece. sides: (N, 4) intp, the edge of ``unit_mesh`` below each
    side, or NONE. first_child: (N,) intp, NONE for leaves. low, high: (N, 3), the corners of boxes around the pieces,
    or if smaller around their leaves. least, greatest: (N,) float64, the factors on the tolerance over each, all 1
    where it is the same everywhere.
    """

    coefficients: FloatArray
    excess: FloatArray
    middles: FloatArray
    low: FloatArray
    high: FloatArray
    faces: IndexArray
    units: IndexArray
    sides: IndexArray
    first_child: IndexArray
    least: FloatArray
    greatest: FloatArray
    _parents: IndexArray
    _store: IndexArray
    _row: IndexArray

    def __init__(
        self,
        units: Refinement,
        unit_faces: IndexArray,
        tick: Callable[[], None],
        factors: PieceFactors | None = None,
    ) -> None:
        """units: quads; unit_faces: (n,) intp, the control face of each. tick: called again and again; it may raise to
        stop. factors: on the tolerance, if it varies; the units are then all quads of a level."""
        count = len(units.bases)
        self.unit_mesh = units.mesh if units.mesh.face_count == count else faces_alone(units.mesh, np.arange(count))
        self._tick, self._factors = tick, factors
        self.count, self._columns = 0, dict[str, Column]()
        self._stores: list[Refinement | Nets] = []
        self._add_units(units, unit_faces)

    @property
    def unit_count(self) -> int:
        """The number of units, which are the first pieces."""
        return self.unit_mesh.face_count

    @cached_property
    def edge_units(self) -> IndexArray:
        """(E, 2) intp, the two units at each edge; NONE at edges with another number of units."""
        mesh = self.unit_mesh
        order = np.argsort(mesh.corner_edges, kind="stable")
        first = np.cumsum(mesh.edge_face_counts) - mesh.edge_face_counts
        found = np.full((mesh.edge_count, 2), NONE)
        paired = np.flatnonzero(mesh.edge_face_counts == 2)
        found[paired] = mesh.corner_faces[order[first[paired][:, None] + np.arange(2)]]
        return found

    @cached_property
    def is_smooth_edge(self) -> BoolArray:
        """(E,) bool: whether the surface has one tangent plane along an edge of the units, which face the same way."""
        mesh = self.unit_mesh
        starts = mesh.corner_vertices == mesh.edge_vertices[mesh.corner_edges, 0]
        forwards = np.bincount(mesh.corner_edges, starts, mesh.edge_count)
        return (mesh.edge_face_counts == 2) & (forwards == 1) & np.isfinite(mesh.edge_sharpness)

    def is_bilinear(self, pieces: IndexArray) -> BoolArray:
        """(n,) bool: whether pieces (n,) are bilinear facets, with middles off the surface by up to the excess."""
        return self._are_stored(pieces, Refinement)

    def has_net(self, pieces: IndexArray) -> BoolArray:
        """(n,) bool: whether pieces (n,) have an extraordinary vertex at their first corner alone."""
        return self._are_stored(pieces, Nets)

    def _are_stored(self, pieces: IndexArray, kind: type) -> BoolArray:
        """(n,) bool: whether the points of pieces (n,) are in a store of this kind."""
        found = np.array([isinstance(store, kind) for store in self._stores] + [False])
        return found[self._store[pieces]]

    def units_at(self, vertices: IndexArray) -> tuple[IndexArray, IndexArray]:
        """(K,) intp twice: the indices of vertices (n,), and the units around each."""
        counts = self.unit_mesh.vertex_face_counts
        owners = np.repeat(np.arange(len(vertices)), counts[vertices])
        starts = np.cumsum(counts) - counts
        return owners, self._units_by_vertex[ranges(starts[vertices], counts[vertices])]

    @cached_property
    def _units_by_vertex(self) -> IndexArray:
        """(4n,) intp: the units around each vertex, vertex by vertex."""
        return self.unit_mesh.corner_faces[np.argsort(self.unit_mesh.corner_vertices, kind="stable")]

    def leaves(self) -> IndexArray:
        """The pieces that are not split: they cover the surface."""
        return np.flatnonzero(self.first_child == NONE)

    def children(self, parents: IndexArray) -> IndexArray:
        """(n, 4) intp: the children of parents (n,)."""
        return self.first_child[parents][:, None] + np.arange(4)

    def leaves_of(self, owners: IndexArray, pieces: IndexArray) -> tuple[IndexArray, IndexArray]:
        """The leaves of pieces (K,), each with its owner (K,)."""
        found = []
        while len(pieces):
            is_leaf = self.first_child[pieces] == NONE
            found.append((owners[is_leaf], pieces[is_leaf]))
            owners, pieces = np.repeat(owners[~is_leaf], 4), self.children(pieces[~is_leaf]).ravel()
        return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])

    def split(self, pieces: IndexArray) -> IndexArray:
        """(4n,) intp: the four children of each of n leaves, not in the order of the leaves."""
        bicubic = pieces[self._store[pieces] == NONE]
        made = [self._add_children(_quarters(self, block), block) for block in index_chunks(bicubic, AT_ONCE)]
        others = pieces[self._store[pieces] != NONE]
        for number in np.unique(self._store[others]).tolist():
            store, chosen = self._stores[number], others[self._store[others] == number]
            made.append(self._divide(store, chosen) if isinstance(store, Nets) else self._refine(store, chosen))
            self._tighten(chosen)
        return np.concatenate([np.zeros(0, dtype=np.intp), *made])

    def _add_units(self, refinement: Refinement, unit_faces: IndexArray) -> None:
        units = np.arange(self.unit_count)
        new = self._descendants(refinement, self.unit_mesh.corner_edges.reshape(-1, 4))
        if self._factors:
            self._factors.add_units(len(units), new.turned)
        self._add(new, unit_faces, units, np.full(len(units), NONE))
        # Most of these have several extraordinary corners, and their children one each.
        self.split(units[self.is_bilinear(units)])

    def factors_at(self, pieces: IndexArray, weights: FloatArray, points: FloatArray) -> FloatArray:
        """(n·k,): the factors on the tolerance at points (n·k, 3) of the surface, those in pieces (n,) with the weights
        (k, 4) of the corners, and no less."""
        if self._factors is None:
            return np.ones(len(points))
        return self._factors.at(self._factors.places(pieces, weights), points)

    def _refine(self, refinement: Refinement, pieces: IndexArray) -> IndexArray:
        """The children of descendants after one more Catmull-Clark step."""
        pieces = pieces[np.argsort(self._row[pieces])]
        wanted = np.zeros(len(refinement.bases), dtype=bool)
        wanted[self._row[pieces]] = True
        children = refinement.keep(wanted).refined()
        return self._add_children(self._descendants(children, self._sides_of_children(pieces)), pieces)

    def _divide(self, store: Nets, pieces: IndexArray) -> IndexArray:
        """The children of extraordinary patches of one valence: an extraordinary one at corner 0, and regular ones."""
        refined, regular = children_of_nets(store.nets[:, self._row[pieces]], store.valence)
        count = 4 * len(pieces)
        coefficients, excess = np.empty((len(pieces), 4, 3, 16)), np.zeros(count)
        coefficients[:, 0], own_middles, excess[::4] = pieces_of_nets(refined, store.valence, self._tick)
        coefficients[:, 1:] = regular
        coefficients = coefficients.reshape(-1, 3, 16)
        middles = coefficients @ MIDDLE
        middles[::4] = own_middles
        stores, rows = np.full(count, NONE), np.full(count, NONE)
        stores[::4], rows[::4] = len(self._stores), np.arange(len(pieces))
        self._stores.append(Nets(store.valence, refined))
        sides = self._sides_of_children(pieces)
        new = NewPieces(coefficients, middles, excess, sides, stores, rows, np.zeros(count, dtype=np.intp))
        return self._add_children(new, pieces)

    def _sides_of_children(self, pieces: IndexArray) -> IndexArray:
        """(4n, 4): the sides of children. Corner 0 of the child at corner c is that corner: side 0 of the child lies on
        side c, side 3 on the side before."""
        sides = np.full((len(pieces), 4, 4), NONE)
        for corner in range(4):
            sides[:, corner, 0] = self.sides[pieces, corner]
            sides[:, corner, 3] = self.sides[pieces, corner - 1]
        return sides.reshape(-1, 4)

    def _tighten(self, parents: IndexArray) -> None:
        """Shrink the boxes of parents to those of their children, up to the units."""
        while len(parents):
            children = self.children(parents)
            self.low[parents] = np.maximum(self.low[parents], self.low[children].min(axis=1))
            self.high[parents] = np.minimum(self.high[parents], self.high[children].max(axis=1))
            parents = np.unique(self._parents[parents])
            parents = parents[parents != NONE]

    def _descendants(self, refinement: Refinement, sides: IndexArray) -> NewPieces:
        """The first faces of a refinement, one for each row of sides (n, 4), as pieces."""
        count, mesh = len(sides), refinement.mesh
        regular, extraordinary, others = by_valence(mesh, np.arange(count), classify_patches(mesh), LARGEST_VALENCE)
        coefficients, middles, excess = np.empty((count, 3, 16)), np.empty((count, 3)), np.zeros(count)
        sides = sides.copy()
        stores, rows, turned = np.full(count, NONE), np.full(count, NONE), np.zeros(count, dtype=np.intp)
        for block in chunks(len(regular), AT_ONCE):
            coefficients[regular[block]] = _bernstein(regular_nets(mesh, regular[block]))
            self._tick()
        for valence, chosen, corners in extraordinary:
            nets = extraordinary_nets(mesh, corners, valence)
            coefficients[chosen], middles[chosen], excess[chosen] = pieces_of_nets(nets, valence, self._tick)
            # Corners of these pieces are counted from the extraordinary corner on.
            turned[chosen] = corners - mesh.face_starts[chosen]
            sides[chosen] = np.take_along_axis(sides[chosen], (turned[chosen, None] + np.arange(4)) % 4, axis=1)
            stores[chosen], rows[chosen] = len(self._stores), np.arange(len(chosen))
            self._stores.append(Nets(valence, nets))
        if others.any():
            rest = refinement.keep(others)
            coefficients[others] = bilinear_pieces(rest.limits_at_corners.reshape(-1, 4, 3))
            excess[others] = support_bounds(rest.mesh, Vertices.LIMIT)[: len(rest.bases)]
            stores[others], rows[others] = len(self._stores), np.arange(len(rest.bases))
            self._stores.append(rest)
            self._tick()
        plain = np.concatenate([regular, np.flatnonzero(others)])
        middles[plain] = coefficients[plain] @ MIDDLE
        return NewPieces(coefficients, middles, excess, sides, stores, rows, turned)

    def _add_children(self, new: NewPieces, parents: IndexArray) -> IndexArray:
        """Append four pieces for each parent."""
        self.first_child[parents] = self.count + 4 * np.arange(len(parents))
        if self._factors:
            self._factors.add_children(parents, self._store[parents] == NONE, new.turned)
        faces, units, parents = (np.repeat(each, 4) for each in (self.faces[parents], self.units[parents], parents))
        return self._add(new, faces, units, parents)

    def _add(self, new: NewPieces, faces: IndexArray, units: IndexArray, parents: IndexArray) -> IndexArray:
        self._tick()
        least = greatest = np.ones(len(faces))
        if self._factors:
            added = np.arange(self.count, self.count + len(faces))
            least, greatest = self._factors.over(added, new.coefficients, new.excess)
        columns = {
            "coefficients": new.coefficients,
            "middles": new.middles,
            "excess": new.excess,
            "low": new.coefficients.min(axis=2) - new.excess[:, None],
            "high": new.coefficients.max(axis=2) + new.excess[:, None],
            "faces": faces,
            "units": units,
            "first_child": np.full(len(faces), NONE),
            "least": least,
            "greatest": greatest,
            "_parents": parents,
            "sides": new.sides,
            "_store": new.stores,
            "_row": new.rows,
        }
        for name, values in columns.items():
            column = self._columns.setdefault(name, Column(values[:0]))
            column.append(values)
            setattr(self, name, column.values)
        self.count += len(faces)
        return np.arange(self.count - len(faces), self.count)


def bezier_pieces(
    control: PolygonMesh, units_wanted: int, tick: Callable[[], None], factors: PieceFactors | None = None
) -> BezierPieces:
    """The limit surface of a mesh with explicit sharpness. units_wanted: levels of units are added while they have no
    more units than this. factors: on the tolerance over this mesh, if it varies."""
    mesh, faces = subdivide(control), control.corner_faces
    while 4 * mesh.face_count <= units_wanted:
        mesh, faces = subdivide(mesh), np.repeat(faces, 4)
        tick()
    return BezierPieces(Refinement(mesh, np.arange(mesh.face_count)), faces, tick, factors)


def bilinear_pieces(corners: FloatArray) -> FloatArray:
    """(N, 3, 16): the coefficients of bilinear facets over corners (N, 4, 3) in a face's order."""
    return np.matmul(corners.swapaxes(1, 2), BILINEAR)


def _bilinear_weights() -> FloatArray:
    along = np.arange(4) / 3
    rises, falls = along, 1 - along
    return np.stack([np.kron(*pair) for pair in ((falls, falls), (rises, falls), (rises, rises), (falls, rises))])


# (4, 16): how much each corner counts in the coefficients of a bilinear facet.
BILINEAR = _bilinear_weights()


def _bernstein(nets: FloatArray) -> FloatArray:
    """(N, 3, 16) from the nets of regular faces (4, 4, N, 3)."""
    points = np.moveaxis(nets.reshape(16, -1, 3), 0, 2)
    return np.matmul(points, NET_TO_BERNSTEIN.T)


def _quarters(pieces: BezierPieces, parents: IndexArray) -> NewPieces:
    coefficients = np.matmul(pieces.coefficients[parents][:, None], QUARTERS.swapaxes(1, 2)).reshape(-1, 3, 16)
    sides = np.where(QUARTER_SIDES, pieces.sides[parents][:, None], NONE).reshape(-1, 4)
    none, excess = np.full(len(sides), NONE), np.repeat(pieces.excess[parents], 4)
    return NewPieces(coefficients, coefficients @ MIDDLE, excess, sides, none, none, np.zeros_like(none))
