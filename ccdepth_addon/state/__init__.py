# SPDX-License-Identifier: GPL-3.0-or-later
"""The records of scenes and meshes: settings, values with their colours, and whether these still hold."""
