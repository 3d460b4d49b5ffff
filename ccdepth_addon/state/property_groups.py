# SPDX-License-Identifier: GPL-3.0-or-later
"""The registration of our data on scenes, meshes and objects, on each as ``ccdepth``."""

import bpy
from bpy.props import PointerProperty

from .record import Contributor, DepthRow, Measurement, MeshRecord
from .result_record import AppliedModifier, ResultRecord, SourceMaterial
from .settings import SceneSettings

HOLDERS = {"Scene": SceneSettings, "Mesh": MeshRecord, "Object": ResultRecord}

# Groups held by other groups come first.
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (DepthRow, Contributor, Measurement, AppliedModifier, SourceMaterial, *HOLDERS.values())
)


def register() -> None:
    _register_classes()
    for holder, group in HOLDERS.items():
        getattr(bpy.types, holder).ccdepth = PointerProperty(type=group)


def unregister() -> None:
    for holder in HOLDERS:
        del getattr(bpy.types, holder).ccdepth
    _unregister_classes()
