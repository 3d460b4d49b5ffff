# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators do to objects: what has to be computed once for several of them, and how answers become one."""
