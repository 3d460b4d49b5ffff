# SPDX-License-Identifier: GPL-3.0-or-later
"""Array types, chunks, matrix products, tables, threads, vectors."""
