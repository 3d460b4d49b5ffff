# SPDX-License-Identifier: GPL-3.0-or-later
"""The normals stored at the corners of leaves, and at the middles of their sides.

A stored normal is the normal of the limit surface at its point, on the leaf's own side of a crease. Where the surface
turns by more than the shading angle within the reach at a semi-sharp edge or vertex, the leaf stores the normal from
the reach inside instead: at this scale such a place is drawn as a sharp edge (docs/normals.md).
"""

from __future__ import annotations

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import angles_between, lengths
from ..surface.limit_normals import limit_normals
from ..surface.sharpness import has_semi_sharp
from .plan import Plan
from .quad_normals import normals_of_quads

# The largest part of a leaf's sides by which a normal may be from inside.
MOST_INSIDE = 0.5

# A turn within the reach is that of an edge if the next part of the surface, as wide, turns less than this part of it.
SHARP = 0.25


def leaf_normals(plan: Plan, leaves: IndexArray) -> FloatArray:
    """(2, S, 3): unit normals at the slots of leaves, at the corners and at the middles of the sides after them, leaf
    by leaf, in the space of the mesh."""
    tree = plan.tree
    counts = tree.slot_counts(leaves)
    starts = np.cumsum(counts) - counts
    found = np.empty((2, int(counts.sum()), 3))
    are_bicubic = plan.surfaces.are_bicubic(leaves)
    for some in index_chunks(np.flatnonzero(are_bicubic), AT_ONCE):
        own = normals_of_quads(plan.surfaces.coefficients(leaves[some]))
        found[:, starts[some, None] + np.arange(4)] = own.reshape(2, 4, -1, 3).swapaxes(1, 2)
    others = np.flatnonzero(~are_bicubic)
    if len(others):
        slots = np.repeat(starts[others], counts[others])
        slots += np.arange(len(slots)) - np.repeat(np.cumsum(counts[others]) - counts[others], counts[others])
        found[:, slots] = _normals_of_others(plan, leaves[others])
    return found


def _normals_of_others(plan: Plan, leaves: IndexArray) -> FloatArray:
    """(2, S, 3): the normals of leaves that are not bicubic, as of ``leaf_normals``."""
    tree, angle, counts = plan.tree, plan.request.shading, plan.tree.slot_counts(leaves)
    corners = plan.positions.of(tree.slot_vertices[tree.slots(leaves)])
    starts = np.cumsum(counts) - counts
    following = np.arange(len(corners)) + 1
    following[starts + counts - 1] = starts
    sides = np.repeat(np.maximum.reduceat(lengths(corners[following] - corners), starts), counts)

    slots = tree.slots(leaves)
    wanted = np.stack([np.ones(len(slots), dtype=bool), tree.hanging(slots)])
    exact = _normals_inside(plan, leaves, np.zeros(len(sides)), wanted)
    turning = wanted & np.repeat(are_semi_sharp(plan, leaves), counts)
    if not angle or not turning.any():
        return exact
    reaches = np.repeat(plan.reaches(leaves), counts)
    # Parameters on irregular faces are dyadic.
    halvings = np.clip(np.floor(np.log2(np.maximum(sides, 1e-300) / np.maximum(reaches, 1e-300))), 1, 20)
    steps = np.ldexp(1.0, -halvings.astype(np.int32))
    inside, farther = (
        _normals_inside(plan, leaves, each, turning) for each in (steps, np.minimum(2 * steps, MOST_INSIDE))
    )
    turned, further = angles_between(exact, inside), angles_between(inside, farther)
    is_sharp = turning & (turned > angle) & (further < SHARP * turned)
    return np.where(is_sharp[..., None], inside, exact)


def _normals_inside(plan: Plan, leaves: IndexArray, steps: FloatArray, wanted: BoolArray) -> FloatArray:
    """(2, S, 3): the normals at steps (S,) inwards from the wanted places of leaves, (2, S) bool; zero elsewhere."""
    found = np.zeros((*wanted.shape, 3))
    for own, some, points in zip(found, wanted, plan.tree.slot_points(leaves, steps), strict=True):
        own[some] = limit_normals(plan.tree.mesh, points.at(some))
    return found


def are_semi_sharp(plan: Plan, leaves: IndexArray) -> BoolArray:
    """(n,) bool: whether the surface over leaves is narrow at semi-sharp edges or vertices; elsewhere tiles are small
    around vertices without a reason in the shape."""
    found, is_quad = np.zeros(len(leaves), dtype=bool), plan.tree.is_quad(leaves)
    for some in (is_quad, ~is_quad):
        own = np.flatnonzero(some & ~plan.surfaces.are_bicubic(leaves))
        for places, refinement in plan.surfaces.refinements(leaves[own]):
            at_corners = has_semi_sharp(refinement.mesh)[refinement.corner_vertices()]
            found[own[places]] = np.logical_or.reduceat(at_corners, refinement.mesh.face_starts[: len(places)])
    return found
