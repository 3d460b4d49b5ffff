#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# test.sh [PYTEST-OPTION…] — the whole test suite, in a few processes at a time; `-n 0` for a single one
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/environment.sh"
prepare_environment -r "$here/../tests/requirements.txt"
cd "$here/.."
# The bpy module can hang when the interpreter winds up.
timeout --kill-after 30 2700 "$python" -m pytest -n auto --maxprocesses 4 --dist worksteal "$@"
