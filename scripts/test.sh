#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# test.sh [--thorough] [PYTEST-OPTION…] — the test suite, in a few processes at a time; `-n 0` for a single one
#
# --thorough adds all combinations, dense oracles, linear programs and random scenes.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/environment.sh"
prepare_environment -r "$here/../tests/requirements.txt"
cd "$here/.."
# Tests run side by side: threads of a matrix product would wait for each other.
export OPENBLAS_NUM_THREADS=1
exec "$python" scripts/supervise_tests.py "$python" -m pytest -p tests.progress -q -o console_output_style=classic \
  --durations 10 -n auto --maxprocesses 4 --dist worksteal "$@"
