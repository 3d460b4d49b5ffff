#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# lint.sh — ruff (check and format) over everything, and mypy over the add-on
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/environment.sh"
prepare_environment -r "$here/../tests/requirements.txt" -r "$here/requirements-lint.txt"
cd "$here/.."
"$python" -m ruff check .
"$python" -m ruff format --check .
"$python" -m mypy ccdepth_addon
