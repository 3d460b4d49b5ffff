# SPDX-License-Identifier: GPL-3.0-or-later
"""Array types, chunks, masks, matrix products, tables, threads, vectors."""
