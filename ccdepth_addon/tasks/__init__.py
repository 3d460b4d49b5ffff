# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → answers: what is computed once for several objects, and how answers are merged."""
