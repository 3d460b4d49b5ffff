# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → answers: computations for several objects at once, and merged answers."""
