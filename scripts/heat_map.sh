#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# heat_map.sh [MESH [OPTION…]] — the depths of Suzanne, and of a .blend, .obj, .ply or .stl file
# Prints the tables of depths, and writes a .blend file with the attributes, and the heat map baked to a colour
# attribute, and a picture of it for each, to the folder in OUTPUT (by default ./build). For the options see `heat_map.sh MESH --help`.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/environment.sh"
prepare_environment

output=${OUTPUT:-build}
mkdir -p "$output"

heat_map() { # NAME [MESH] [OPTION…]
  timeout 1800 "$python" "$here/heat_map.py" --output "$output/$1.blend" --picture "$output/$1.png" --overwrite "${@:2}"
  timeout 600 "$python" "$here/bake_colors.py" "$output/$1.blend"
}

heat_map suzanne
if (($#)); then
  name=$(basename "$1")
  heat_map "${name%.*}" "$@"
fi
