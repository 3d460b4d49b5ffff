# SPDX-License-Identifier: GPL-3.0-or-later
"""The door Blender opens. Nothing is imported before registration, so that tools may import this file without
Blender."""


def register() -> None:
    """Register the add-on with Blender."""
    from . import ccdepth_addon

    ccdepth_addon.register()


def unregister() -> None:
    """Take everything the add-on registered back out of Blender."""
    from . import ccdepth_addon

    ccdepth_addon.unregister()
