# SPDX-License-Identifier: GPL-3.0-or-later
"""The records of scenes, meshes and viewports: settings, values with their colours, and whether these still hold."""
