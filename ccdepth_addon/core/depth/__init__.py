# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth of faces, and the level that holds for all of them."""
