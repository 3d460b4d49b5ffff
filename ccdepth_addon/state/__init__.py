# SPDX-License-Identifier: GPL-3.0-or-later
"""What scenes, meshes and viewports keep: settings, results with their colours, and whether these still hold."""
