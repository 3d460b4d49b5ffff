# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map: values of faces drawn over the 3D View, like Blender's own overlays. Nothing else of the view is
touched.

The vertices of each mesh are kept until Blender says that its geometry has changed, and the list of items in a 3D View
until anything has changed. Values go to the graphics card, and colours come from a ramp, so another range is another
number.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any, NamedTuple

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent

from ..exchange.displayed_mesh import DisplayedMesh
from ..registration import add_handlers, is_of_window, remove_handlers
from ..state.colors import BEYOND, scale_colors
from ..state.heat_map import Shown, on_scale, shown, top
from .overlay_items import Item, items, read_item

# A multiple of all depths, so that each has its exact colour; the last step is for values beyond the scale.
RAMP_STEPS = 240

# The overlay is drawn nearer than its surface by these parts of the distance to the eye, and of the stored depth.
# Either alone leaves holes, far away or near by.
NEARER, NEARER_IN_DEPTH = 2e-4, 5e-7

# The part of the light that depends on the direction of a surface.
SHADE = 0.4

EDGE_OPACITY = 0.35

# The largest opacity in Edit Mode, with edges and selection below the overlay, and in X-Ray.
LARGEST_TRANSLUCENT = 0.6

# ``look``: opacity, shade, for edges the pixels to a unit at distance 1, and the value of the last colour, 0 for
# selected faces. Edges fade in from 2 to 10 pixels. The frame buffer wants linear colours, which it encodes itself.
VERTEX_SHADER = """
void main() {
  vec4 place = ModelViewProjectionMatrix * vec4(pos, 1.0);
  seen = vec3(lens.xy * place.xy, lens.z * place.z + lens.w * place.w);
  number = look.z > 0.0 ? clamp((value * look.z / place.w - 2.0) / 8.0, 0.0, 1.0) : value;
  place.z = bias.w > 0.5 ? 0.9999999 * place.w : place.z - bias.x - bias.y * place.w;
  gl_Position = place;
}
"""
FRAGMENT_SHADER = """
void main() {
  if (look.z > 0.0) {
    fragColor = vec4(0.0, 0.0, 0.0, look.x * number);
    return;
  }
  if (look.w == 0.0) {
    float along = mod(gl_FragCoord.x + gl_FragCoord.y, 10.0);
    fragColor = along < 2.0 ? vec4(vec3(1.0), 0.9) : along < 4.0 ? vec4(vec3(0.0), 0.5) : vec4(vec3(1.0), 0.2);
    return;
  }
  int last = textureSize(ramp, 0).x - 1;
  int place = number > look.w ? last : clamp(int(number / look.w * float(last - 1) + 0.5), 0, last - 1);
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float facing = abs(dot(normal, bias.z > 0.5 ? normalize(seen) : vec3(0.0, 0.0, 1.0)));
  vec3 color = texelFetch(ramp, ivec2(place, 0), 0).rgb * mix(1.0, facing, look.y);
  vec3 linear = mix(pow((color + 0.055) / 1.055, vec3(2.4)), color / 12.92, step(color, vec3(0.04045)));
  fragColor = vec4(linear, look.x);
}
"""


class _Batches(NamedTuple):
    """The buffers of a mesh on the graphics card."""

    faces: gpu.types.GPUBatch | None
    chosen: gpu.types.GPUBatch | None
    edges: gpu.types.GPUBatch | None


_Drawn = tuple[_Batches, Item]

# None of a mesh without values.
_batches: dict[Hashable, _Batches | None] = {}

# By the session identifier of an object, the keys of items that change with it.
_keys: dict[int, set[Hashable]] = {}

_lists: dict[Hashable, list[_Drawn]] = {}

# The number of objects at Blender's last update.
_object_count = 0

_handle: Any = None
_shader: gpu.types.GPUShader | None = None
_ramp: gpu.types.GPUTexture | None = None


def draw() -> None:
    """Draw the heat map in the current 3D View."""
    context = bpy.context
    settings = context.scene.ccdepth
    kind = shown(settings)
    if kind is None or not context.space_data.overlay.show_overlays:
        return
    if not settings.heat_map_playing and _is_playing(context):
        return
    drawn = _list(context, kind)
    if drawn:
        _View(context, kind).paint_all(drawn)


def _is_playing(context: bpy.types.Context) -> bool:
    return any(window.screen.is_animation_playing for window in context.window_manager.windows)


def _list(context: bpy.types.Context, kind: Shown) -> list[_Drawn]:
    """The objects and instances to draw in the current 3D View."""
    space, layer = context.space_data, context.view_layer
    places = space.local_view is not None, space.use_local_collections, space.show_object_viewport_mesh
    key = kind, context.scene.session_uid, layer.name, space.as_pointer(), places
    if key not in _lists:
        _lists[key] = [
            (batches, item)
            for evaluated, item in items(context.evaluated_depsgraph_get(), space, kind)
            if (batches := _batches_of(evaluated, item, kind)) is not None
        ]
    return _lists[key]


def _batches_of(evaluated: bpy.types.Object, item: Item, kind: Shown) -> _Batches | None:
    """The batches of an item, made if missing."""
    key = kind, item.key
    if key not in _batches:
        mesh = read_item(evaluated, kind)
        _batches[key] = None if mesh is None else _made(mesh, kind)
    _keys.setdefault(item.owner, set()).add(key)
    return _batches[key]


def _made(mesh: DisplayedMesh, kind: Shown) -> _Batches:
    corners = _buffer(mesh.corners, on_scale(kind, mesh.values))
    faces, chosen = (
        gpu.types.GPUBatch(type="TRIS", buf=corners, elem=gpu.types.GPUIndexBuf(type="TRIS", seq=triangles))
        if len(triangles)
        else None
        for triangles in (mesh.triangles, mesh.chosen)
    )
    edges = None
    if len(mesh.edges):
        lengths = np.linalg.norm(mesh.edges[:, 0] - mesh.edges[:, 1], axis=1)
        edges = gpu.types.GPUBatch(type="LINES", buf=_buffer(mesh.edges.reshape(-1, 3), np.repeat(lengths, 2)))
    return _Batches(faces, chosen, edges)


def _buffer(places: Any, values: Any) -> gpu.types.GPUVertBuf:
    """Places (N, 3) and a number for each (N,)."""
    form = gpu.types.GPUVertFormat()
    form.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    form.attr_add(id="value", comp_type="F32", len=1, fetch_mode="FLOAT")
    buffer = gpu.types.GPUVertBuf(form, len(places))
    buffer.attr_fill("pos", np.ascontiguousarray(places))
    buffer.attr_fill("value", np.ascontiguousarray(values, dtype=np.float32))
    return buffer


class _View:
    """The current 3D View, as the shader needs it."""

    def __init__(self, context: bpy.types.Context, kind: Shown) -> None:
        self.kind, self.settings, self.shader = kind, context.scene.ccdepth, _bound_shader()
        window, shading = context.region_data.window_matrix, context.space_data.shading
        self.is_xray = shading.show_xray_wireframe if shading.type == "WIREFRAME" else shading.show_xray
        self.is_xray = self.is_xray and shading.type in {"WIREFRAME", "SOLID"}
        self.pixels = window[1][1] * context.region.height / 2.0
        # In perspective z is A z + B with w = -z, so adding k B brings it nearer by k of the distance. Otherwise w is
        # 1.
        self.perspective = float(window[3][3] == 0.0)
        unit = window[2][3] if self.perspective else 2.0 * window[2][2] / window[1][1]
        self.nearer = NEARER * abs(unit)
        depth = (0.0, -1.0) if self.perspective else (1.0 / window[2][2], -window[2][3] / window[2][2])
        self.shader.uniform_float("lens", (1.0 / window[0][0], 1.0 / window[1][1], *depth))

    def paint_all(self, drawn: list[_Drawn]) -> None:
        """Draw everything."""
        in_front = [each for each in drawn if each[1].in_front]
        gpu.state.blend_set("ALPHA")
        # The depth of objects In Front, and before 5.0 of all objects in X-Ray, is elsewhere: they get one here. All
        # others get one as well: far sides of thin parts, drawn nearer, would be seen beside the near sides.
        gpu.state.color_mask_set(False, False, False, False)
        gpu.state.depth_mask_set(True)
        gpu.state.depth_test_set("ALWAYS")
        self._paint(in_front, farthest=True)
        gpu.state.depth_test_set("LESS_EQUAL")
        self._paint(drawn)
        gpu.state.depth_mask_set(False)
        gpu.state.color_mask_set(True, True, True, True)
        self._paint(drawn)
        self._paint(drawn, part="chosen")
        # Edit Mode draws its own edges.
        self._paint([each for each in drawn if not each[1].is_edited], part="edges")
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")

    def _paint(self, drawn: Iterable[_Drawn], *, part: str = "faces", farthest: bool = False) -> None:
        uniform, push, pop = self.shader.uniform_float, gpu.matrix.push, gpu.matrix.pop
        nearer = 1.0 if part == "faces" else 2.0
        uniform("bias", (nearer * self.nearer, nearer * NEARER_IN_DEPTH, self.perspective, float(farthest)))
        opacity, last = self.settings.heat_map_opacity, None
        for batches, each in drawn:
            batch = getattr(batches, part)
            if batch is None:
                continue
            seen = min(opacity, LARGEST_TRANSLUCENT) if each.is_edited or self.is_xray else opacity
            if part == "chosen":
                look = (1.0, 0.0, 0.0, 0.0)
            elif part == "edges":
                look = (EDGE_OPACITY * seen, 0.0, self.pixels * each.scale, 1.0)
            else:
                look = (seen, SHADE, 0.0, top(self.kind, each.tolerance, self.settings))
            if look != last:
                uniform("look", look)
                last = look
            push()
            gpu.matrix.multiply_matrix(each.matrix)
            batch.draw(self.shader)
            pop()


def _bound_shader() -> gpu.types.GPUShader:
    """The shader, with the ramp of colours."""
    global _shader, _ramp
    if _shader is None or _ramp is None:
        _shader, _ramp = _new_shader(), _new_ramp()
    _shader.bind()
    _shader.uniform_sampler("ramp", _ramp)
    return _shader


def _new_shader() -> gpu.types.GPUShader:
    between = gpu.types.GPUStageInterfaceInfo("ccdepth_overlay")
    between.flat("FLOAT", "number")
    between.smooth("VEC3", "seen")
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC3", "pos")
    info.vertex_in(1, "FLOAT", "value")
    info.vertex_out(between)
    # 112 bytes in all; from 128 on Blender warns at each draw.
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    for name in ("bias", "look", "lens"):
        info.push_constant("VEC4", name)
    info.sampler(0, "FLOAT_2D", "ramp")
    info.fragment_out(0, "VEC4", "fragColor")
    info.vertex_source(VERTEX_SHADER)
    info.fragment_source(FRAGMENT_SHADER)
    return gpu.shader.create_from_info(info)


def _new_ramp() -> gpu.types.GPUTexture:
    colors = np.vstack([scale_colors(np.linspace(0.0, 1.0, RAMP_STEPS + 1)), BEYOND])
    pixels = np.column_stack([colors, np.ones(len(colors))]).astype(np.float32)
    data = gpu.types.Buffer("FLOAT", pixels.size, pixels.ravel().tolist())
    return gpu.types.GPUTexture((len(pixels), 1), format="RGBA32F", data=data)


@persistent
def _notice_updates(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    global _object_count
    if not is_of_window(depsgraph):
        return
    _lists.clear()
    # An update of a mesh comes with updates of its users.
    changed = [update.id.original for update in depsgraph.updates if update.is_updated_geometry]
    gone = {each.session_uid for each in changed if isinstance(each, bpy.types.Object)}
    before, _object_count = _object_count, len(bpy.data.objects)
    if _object_count < before:
        gone |= _keys.keys() - {each.session_uid for each in bpy.data.objects}
    for uid in gone:
        for key in _keys.pop(uid, ()):
            _batches.pop(key, None)


@persistent
def _forget_everything(*_: Any) -> None:
    for kept in (_lists, _batches, _keys):
        kept.clear()


HANDLERS = (
    ("depsgraph_update_post", _notice_updates),
    ("frame_change_post", _notice_updates),
    ("undo_post", _forget_everything),
    ("redo_post", _forget_everything),
    ("load_pre", _forget_everything),
)


def register() -> None:
    global _handle
    add_handlers(HANDLERS)
    _handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    global _handle, _shader, _ramp
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    remove_handlers(HANDLERS)
    # Blender reports data left on the graphics card as lost when it ends.
    _forget_everything()
    _handle = _shader = _ramp = None
