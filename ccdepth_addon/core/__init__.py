# SPDX-License-Identifier: GPL-3.0-or-later
"""Catmull-Clark surfaces within a tolerance: numpy arrays in, numpy arrays out, nothing of Blender.

The public interface: names that are not listed here may change. scripts/api_docs.py makes docs/api.md from the
docstrings.
"""

from .adaptive.plan import TooManyFacesError
from .adaptive.planner import AdaptiveMesh, count_faces, subdivide_adaptively
from .adaptive.request import AdaptiveRequest, Mode
from .adaptive.subdivided_mesh import SubdividedMesh
from .arrays.types import BoolArray, FloatArray, IndexArray, ShortIndexArray
from .attributes.face_varying import face_varying_surface
from .attributes.interpolation import (
    Evaluate,
    at_corners,
    at_vertices,
    interpolated,
    interpolated_at_vertices,
    nearest_vertices,
)
from .bounds.rounding import largest_coordinates, rounding_allowance, smallest_step
from .depth.common_level import common_level
from .depth.distance_depth import Effort
from .depth.face_depths import (
    METHODS,
    VERTICES,
    check_input,
    check_pose,
    check_tolerance,
    face_depths,
    uniform_level,
)
from .depth.modifier_quality import needed_quality
from .depth.pose_depths import Pose, deepest_pose, pose_depths, raised_depths
from .depth.tolerance import FaceDepths
from .deviation import Deviation, SampledSurface, measure_deviation
from .mesh.polygon_mesh import PolygonMesh, polygon_mesh
from .mesh.touching_faces import surface_boxes
from .mesh.validation import InvalidMeshError, validate
from .progress import Progress, no_report, part_of
from .reduction import Attempt, Places, Proof, Reduction, TriangleMesh
from .surface.evaluation import limit_values
from .surface.limit_normals import limit_normals
from .surface.sharpness import apply_boundary_rule, crease_to_sharpness
from .surface.surface_points import SurfacePoints
from .tolerance.surface_views import Pixels, View, most_pixels
from .tolerance.variation import ToleranceError, Variation

__all__ = [
    "METHODS",
    "VERTICES",
    "AdaptiveMesh",
    "AdaptiveRequest",
    "Attempt",
    "BoolArray",
    "Deviation",
    "Effort",
    "Evaluate",
    "FaceDepths",
    "FloatArray",
    "IndexArray",
    "InvalidMeshError",
    "Mode",
    "Pixels",
    "Places",
    "PolygonMesh",
    "Pose",
    "Progress",
    "Proof",
    "Reduction",
    "SampledSurface",
    "ShortIndexArray",
    "SubdividedMesh",
    "SurfacePoints",
    "ToleranceError",
    "TooManyFacesError",
    "TriangleMesh",
    "Variation",
    "View",
    "apply_boundary_rule",
    "at_corners",
    "at_vertices",
    "check_input",
    "check_pose",
    "check_tolerance",
    "common_level",
    "count_faces",
    "crease_to_sharpness",
    "deepest_pose",
    "face_depths",
    "face_varying_surface",
    "interpolated",
    "interpolated_at_vertices",
    "largest_coordinates",
    "limit_normals",
    "limit_values",
    "measure_deviation",
    "most_pixels",
    "nearest_vertices",
    "needed_quality",
    "no_report",
    "part_of",
    "polygon_mesh",
    "pose_depths",
    "raised_depths",
    "rounding_allowance",
    "smallest_step",
    "subdivide_adaptively",
    "surface_boxes",
    "uniform_level",
    "validate",
]
