# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept on scenes, objects and meshes: settings, results, fingerprints, staleness."""
