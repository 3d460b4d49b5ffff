# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of the heat map, rendered with fewer samples than people get."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide

picture = addon.module("command_line.picture")
materials = addon.module("command_line.picture_materials")
colors = addon.module("state.colors")

# Between a face in the light and one turned away from it.
SHADES = np.linspace(materials.SHADOW, 1.0, 21)


@pytest.fixture(autouse=True)
def one_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "SAMPLES", 1)


def render(path: Path, holder: bpy.types.Object, size: float = 1.0) -> NDArray[np.float32]:
    """(height, width, 3): the sRGB colours of a picture, the top row first."""
    picture.render(bpy.context, [holder], path, "Title", "Subtitle", size=size)
    image = bpy.data.images.load(str(path))
    width, height = round(size * picture.WIDTH), round(size * picture.HEIGHT)
    assert image.size[:] == (width, height)
    pixels = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1, :, :3]


def colorful(pixels: NDArray[np.float32]) -> NDArray[np.bool_]:
    return pixels.max(axis=2) - pixels.min(axis=2) > 0.2


def count_color(pixels: NDArray[np.float32], color: tuple[float, ...]) -> int:
    return int((np.abs(pixels - np.array(color)).max(axis=2) < 1.5 / 255).sum())


def split(pixels: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The part with the objects, and the part with the legend."""
    border = picture.WIDTH - picture.MARGIN - picture.LEGEND_WIDTH
    return pixels[picture.TITLE_HEIGHT + picture.MARGIN :, : border - 1], pixels[:, border - 1 :]


def contents() -> list[tuple[str, str]]:
    kinds = ("scenes", "objects", "meshes", "curves", "cameras", "materials", "images", "worlds", "collections")
    return [(kind, item.name) for kind in kinds for item in getattr(bpy.data, kind) if item.name != "Render Result"]


@pytest.mark.every_blender
def test_the_legend_has_the_exact_colour_of_every_depth_and_the_file_stays_as_it_is(tmp_path: Path) -> None:
    suzanne = scene.add_suzanne()
    suzanne.modifiers.new("Mirror", "MIRROR")
    scene.add_subdivision(suzanne, 1)
    addon.compute(suzanne, tolerance=0.01)
    before, engine = contents(), bpy.context.scene.render.engine
    _, legend = split(render(tmp_path / "picture.png", suzanne))
    assert contents() == before
    assert not suzanne.data.color_attributes
    assert (bpy.context.scene.render.engine, len(suzanne.modifiers)) == (engine, 2)
    depths = addon.histogram(suzanne)
    assert len(depths) > 2
    for color in colors.depth_colors([*depths]):
        assert count_color(legend, color) > 500


def test_faces_have_the_hues_of_their_depths(tmp_path: Path) -> None:
    cube = scene.add_object(meshes.cube())
    addon.compute(cube, tolerance=0.01)
    objects, _ = split(render(tmp_path / "picture.png", cube))
    [depth] = addon.histogram(cube)
    [color] = colors.depth_colors([depth])
    seen = objects[colorful(objects)]
    assert len(seen) > 0.05 * objects.shape[0] * objects.shape[1]
    linear = colors.to_linear
    shades = linear(seen.astype(np.float64)) / linear(color)
    # Every face is evenly darkened, by no more than the shading may take.
    assert np.median(np.ptp(shades, axis=1)) < 0.02
    assert np.quantile(shades, 0.02) > materials.SHADOW - 0.02
    assert np.quantile(shades, 0.98) < 1.02


def test_an_adaptive_mesh_has_the_colours_of_its_distances(tmp_path: Path) -> None:
    [result] = subdivide(scene.add_object(meshes.cube()), tolerance=0.2)
    objects, legend = split(render(tmp_path / "picture.png", result))
    for fraction in (0.0, 0.25, 0.5, 0.75, 1.0):
        [color] = colors.scale_colors(np.array([fraction]))
        # Strips are nearly four pixels high, and the tolerance is marked across the last one.
        assert count_color(legend, color) > 40
    bounds = addon.bounds(result).astype(np.float64)
    lit = colors.to_linear(colors.scale_colors(bounds / result.data.ccdepth.world_tolerance))
    shades = (lit[:, None] * SHADES[:, None]).reshape(-1, 3)
    seen = colors.to_linear(objects[colorful(objects)].astype(np.float64))[::200]
    nearest = np.abs(seen[:, None] - shades[None]).max(axis=2).min(axis=1)
    assert len(seen) > 100
    assert np.quantile(nearest, 0.9) < 0.02


def test_all_objects_are_in_the_picture_whatever_their_size(tmp_path: Path) -> None:
    size = 0.5
    for scale in (1e-4, 1.0, 1e4):
        cube = scene.add_object(meshes.cube())
        cube.scale = (scale, scale, scale)
        cube.location = (1e3 * scale, 0.0, 0.0)
        bpy.context.view_layer.update()
        addon.compute(cube, tolerance=0.01 * scale)
        shown = colorful(render(tmp_path / "picture.png", cube, size))
        rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
        # Edges may stand out by a pixel or two.
        assert rows[-1] <= size * (picture.HEIGHT - picture.MARGIN) + 2
        assert columns[0] >= size * picture.MARGIN - 2
        assert np.ptp(rows) > size * picture.HEIGHT / 2


@pytest.mark.every_blender
def test_its_name_may_have_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a new file, which has no folder either."""
    monkeypatch.chdir(tmp_path)
    holder = scene.add_object(meshes.cube())
    addon.compute(holder)
    picture.render(bpy.context, [holder], Path("picture.png"), "Title", "Subtitle", size=picture.SMALL)
    assert [each.name for each in tmp_path.iterdir()] == ["picture.png"]


def test_without_depths_there_is_no_picture(tmp_path: Path) -> None:
    with pytest.raises(picture.CommandError):
        render(tmp_path / "picture.png", scene.add_suzanne())
    assert not list(tmp_path.iterdir())


def test_the_line_under_several_measured_objects_has_the_tolerance_of_the_worst() -> None:
    small, large = scene.add_object(meshes.cube(), "Small"), scene.add_object(meshes.cube(), "Large")
    large.scale = (10.0,) * 3
    bpy.context.view_layer.update()
    for each_object in (small, large):
        addon.measure(each_object, tolerance=0.5, tolerance_mode="RELATIVE")
    record = large.data.ccdepth
    text = addon.module("command_line.report_text").settings_text([small, large])
    assert text.startswith(f"Tolerance {record.measurement.world_tolerance:.4g} · Largest deviation proved: ")
    assert record.deviation > small.data.ccdepth.deviation
