# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays: their types, chunks of long ones, products with matrices, threads."""
