# SPDX-License-Identifier: GPL-3.0-or-later
"""How far bilinear facets are from the surface of faces of any kind, by refining these.

After one step and more the regular descendants are compared with the facet in Bernstein form; the others lie within
their own bound of a facet of their own, over their control points, whose distance from the facet in question is largest
at a corner (docs/methods.md, Certified).
"""

from __future__ import annotations

import numpy as np

from .bounds import Vertices, second_order_extraordinary, support_bounds
from .mesh import FloatArray
from .patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from .refinement import Refinement
from .splines import bilinear_coefficients, largest_norm, patch_coefficients

# By then what is left of a face around an irregular vertex is small against the face.
REFINEMENTS = 6


def facet_bounds(refinement: Refinement, facets: FloatArray, limit: float) -> FloatArray:
    """(base faces,) float64: the distance between the surface and facets over the children (4, C, 3), at most.

    The descendants are the base faces themselves. A base face is looked at no further once it is known to be within
    the limit, or cannot be any more.
    """
    upper = np.zeros(len(refinement.bases))
    for step in range(REFINEMENTS):
        refinement = refinement.refined()
        kinds = classify_patches(refinement.mesh).kinds[: len(refinement.bases)]
        regular = np.flatnonzero(kinds == PatchKind.REGULAR)
        blocks = patch_coefficients(regular_nets(refinement.mesh, regular))
        blocks -= bilinear_coefficients(facets[:, regular])
        np.maximum.at(upper, refinement.bases[regular], largest_norm(blocks.reshape(16, -1, 3)))
        rest = kinds != PatchKind.REGULAR
        refinement, facets = refinement.keep(rest), facets[:, rest]
        if not len(refinement.bases):
            break
        near = own_facet_bounds(refinement)
        gaps = largest_norm(facets - refinement.control_facets())
        hopeless = np.zeros(len(upper), dtype=bool)
        hopeless[refinement.bases[gaps - near > limit]] = True
        hopeless |= upper > limit
        reached = gaps + near
        last = step == REFINEMENTS - 1
        settled = (reached <= limit) | hopeless[refinement.bases] | last
        np.maximum.at(upper, refinement.bases[settled], reached[settled])
        refinement, facets = refinement.keep(~settled), facets[:, ~settled]
        if not len(refinement.bases):
            break
        facets = refinement.facets_of_children(facets.swapaxes(0, 1).reshape(-1, 3))
    return upper


def own_facet_bounds(refinement: Refinement) -> FloatArray:
    """(descendants,): the distance of quads' surface from the facets over their own control points, at most."""
    mesh = refinement.mesh
    bounds = support_bounds(mesh, Vertices.CONTROL)[: len(refinement.bases)]
    patches = classify_patches(mesh)
    extraordinary = np.flatnonzero(patches.kinds[: len(bounds)] == PatchKind.EXTRAORDINARY)
    corners = patches.extraordinary_corners[extraordinary]
    valences = mesh.vertex_face_counts[mesh.corner_vertices[corners]]
    for valence in np.unique(valences).tolist():
        of_valence = valences == valence
        nets = extraordinary_nets(mesh, corners[of_valence], valence)
        bounds[extraordinary[of_valence]] = second_order_extraordinary(nets, Vertices.CONTROL).value
    return bounds
