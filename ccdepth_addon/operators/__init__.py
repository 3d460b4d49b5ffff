# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators, and what long runs share."""
