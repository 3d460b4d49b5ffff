# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels: the largest distance that moves the image of a part of the surface by at most so many pixels.

docs/tolerance.md has the proof.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray
from ..mesh.polygon_mesh import PolygonMesh

# The margin around the image, in parts of its width and of its height, that counts as the image.
MARGIN = 0.1


@dataclass(frozen=True)
class View:
    """One camera at one frame.

    to_camera: (3, 4) float64, from the space of the positions to the camera's, with lengths kept: x and y along the
    image's width and height, and the depth in front of the camera. focal: in pixels; of an orthographic camera in
    pixels per unit of length. center: the pixel on the camera's axis; size: the width and height of the image, in
    pixels. near: the depth from which the camera sees.
    """

    to_camera: FloatArray
    focal: float
    center: tuple[float, float]
    size: tuple[float, float]
    near: float
    is_perspective: bool

    def measures(self, points: FloatArray) -> FloatArray:
        """(11, …): of points (…, 3) the numbers whose least over the corners of a hull is their least over all of the
        hull: x, y and depth, the same negated, how far beyond each side of the image with its margin, in multiples of
        positive numbers, and negated, the tangent of the angle with the axis, at most that of the margin's corners."""
        x, y, depth = place = np.moveaxis(points @ self.to_camera[:, :3].T + self.to_camera[:, 3], -1, 0)
        widths = depth if self.is_perspective else np.ones_like(depth)
        beyond = []
        for along, (low, high) in zip((x, y), self._image(), strict=True):
            beyond += [low * widths - self.focal * along, self.focal * along - high * widths]
        seen = np.maximum(depth, self.near)
        tangents = np.where(depth >= self.near, np.hypot(x, y) / seen, np.inf)
        return np.stack([*place, *-place, *beyond, -np.minimum(tangents, self._largest_tangent())])

    def distances(self, pixels: FloatArray, least: FloatArray, off_screen: float) -> FloatArray:
        """(n,): the distances allowed by numbers of pixels, for hulls by their least measures (11, n)."""
        low, high, depth = least[:3], -least[3:6], least[2]
        is_off = (least[6:10] > 0).any(axis=0) | (high[2] < self.near)
        if not self.is_perspective:
            flat: FloatArray = np.where(is_off, off_screen, 1.0) * pixels / self.focal
            return flat
        rate = pixels / (self.focal * np.hypot(1.0, least[10]))
        away = np.sqrt((np.maximum(np.maximum(low, -high), 0.0) ** 2).sum(axis=0))
        in_image = rate * np.maximum(depth / (1 + rate), self.near)
        return np.where(is_off, off_screen * pixels / self.focal * np.maximum(away, self.near), in_image)

    def _image(self) -> list[tuple[float, float]]:
        """The least and largest coordinates of the image with its margin, from the axis, in pixels."""
        sides = zip(self.center, self.size, strict=True)
        return [(-MARGIN * size - center, (1 + MARGIN) * size - center) for center, size in sides]

    def _largest_tangent(self) -> float:
        along, across = (max(abs(low), abs(high)) for low, high in self._image())
        return float(np.hypot(along, across)) / self.focal


def least_around(mesh: PolygonMesh, values: FloatArray, count: int) -> FloatArray:
    """(K, count): for the first faces of a mesh the least of values (K, V) at the vertices of a face and of all faces
    that share a vertex, whose hull holds the limit surface of the face."""
    of_faces = np.minimum.reduceat(values[:, mesh.corner_vertices], mesh.face_starts[:-1], axis=1)
    return np.stack([least_of_touching(mesh, row)[:count] for row in of_faces])


def least_of_touching(mesh: PolygonMesh, values: FloatArray) -> FloatArray:
    """(F,): for each face the least of values (F,) over all faces that share a vertex with it."""
    at_vertices = np.full(mesh.vertex_count, np.inf)
    np.minimum.at(at_vertices, mesh.corner_vertices, values[mesh.corner_faces])
    found: FloatArray = np.minimum.reduceat(at_vertices[mesh.corner_vertices], mesh.face_starts[:-1])
    return found
