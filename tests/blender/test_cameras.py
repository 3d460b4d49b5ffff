# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's cameras as views, against ``world_to_camera_view`` and a rendered picture."""

from itertools import product
from math import radians
from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from tests.blender import addon, scene

SIZE = 320, 180


def add_camera(**settings: object) -> bpy.types.Object:
    """The scene's camera, turned and scaled, with settings of its data."""
    data = bpy.data.cameras.new("Camera")
    for name, value in settings.items():
        setattr(data, name, value)
    holder = scene.add("Camera", data)
    holder.location, holder.rotation_euler, holder.scale = (4, -7, 3), (1.2, 0.1, 0.5), (2, 2, 3)
    bpy.context.scene.camera = holder
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *SIZE, 100
    bpy.context.view_layer.update()
    return holder


def places(points: np.ndarray) -> np.ndarray:
    """(P, 2): the places of points of the scene in the camera's view, as parts of its size, by its own numbers."""
    view = addon.module("exchange.cameras").view_of(bpy.context, bpy.context.scene.camera)
    x, y, z = (points @ view.to_camera[:, :3].T + view.to_camera[:, 3]).T
    depth = z if view.is_perspective else 1.0
    found = np.stack([view.center[0] + view.focal * x / depth, view.center[1] + view.focal * y / depth], axis=1)
    return np.column_stack([found / view.size, z])


@pytest.mark.every_blender
@pytest.mark.parametrize(
    ("kind", "fit", "size", "aspect"),
    [
        *product(
            ("PERSP", "ORTHO"), ("AUTO", "HORIZONTAL", "VERTICAL"), ((320, 180), (100, 300)), ((1, 1), (2, 1), (1, 1.5))
        )
    ],
)
def test_the_view_is_blenders(kind: str, fit: str, size: tuple[int, int], aspect: tuple[float, float]) -> None:
    add_camera(type=kind, sensor_fit=fit, lens=35, shift_x=0.2, shift_y=-0.1, sensor_width=30, sensor_height=20)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = size
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    points = np.random.default_rng(1).normal(size=(50, 3))
    given = [world_to_camera_view(bpy.context.scene, bpy.context.scene.camera, Vector(each)) for each in points]
    # Blender computes in single precision.
    np.testing.assert_allclose(places(points), np.array(given), rtol=2e-5, atol=2e-5)


def test_pixels_are_those_of_the_render_size() -> None:
    camera = add_camera(lens=50, sensor_width=36)
    view_of = addon.module("exchange.cameras").view_of
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 1920, 1080, 50
    view = view_of(bpy.context, camera)
    # The thin lens by hand: 960 pixels on 36 mm.
    assert view.focal == pytest.approx(50 / 36 * 960)
    assert view.size == pytest.approx((960, 540))
    assert view.center == pytest.approx((480, 270))
    # Pixels twice as wide as high: the vertical side is the finer one.
    render.pixel_aspect_x = 2
    assert view_of(bpy.context, camera).focal == pytest.approx(50 / 36 * 960 * 2)


def test_a_rendered_point_is_where_the_view_has_it(tmp_path: Path) -> None:
    add_camera(lens=40, shift_x=0.15, shift_y=0.1)
    light, place = scene.add_suzanne(), np.array([0.7, -0.4, 0.3])
    light.data.clear_geometry()
    light.data.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    light.location, light.scale = place, (0.05,) * 3
    light.rotation_euler = bpy.context.scene.camera.rotation_euler
    drawn = bpy.context.scene
    drawn.render.engine, drawn.render.filepath = "CYCLES", str(tmp_path / "point.png")
    drawn.cycles.samples, drawn.cycles.device, drawn.render.film_transparent = 4, "CPU", True
    drawn.render.image_settings.color_mode = "RGBA"
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(drawn.render.filepath)
    alpha = np.array(picture.pixels[:]).reshape(*reversed(SIZE), 4)[..., 3]
    rows, columns = np.indices(alpha.shape)
    found = np.array([(columns + 0.5) * alpha, (rows + 0.5) * alpha]).sum(axis=(1, 2)) / alpha.sum()
    # The middle of its pixels is as exact as a few samples make its edge.
    np.testing.assert_allclose(found, places(place[None])[0, :2] * SIZE, atol=0.25)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda camera: setattr(camera.data, "type", "PANO"), "neither a perspective nor an orthographic camera"),
        (lambda camera: setattr(camera, "scale", (0, 0, 0)), "shows nothing"),
    ],
)
def test_cameras_without_pixels_are_refused(change: object, message: str) -> None:
    camera = add_camera(angle=radians(50))
    change(camera)
    bpy.context.view_layer.update()
    module = addon.module("exchange.cameras")
    with pytest.raises(module.CameraError, match=message):
        module.view_of(bpy.context, camera)
