# SPDX-License-Identifier: GPL-3.0-or-later
# Sourced by the other scripts. `prepare_environment REQUIREMENT…` makes a virtual environment with Blender as a Python
# module and these packages, and puts its interpreter into $python. Anything but results goes to the standard error.
#
#   PYTHON       the Python to use; by default the first found of version 3.11 or 3.13
#   CCDEPTH_BPY  the version of the bpy package, in an environment of its own; by default one that fits the Python
# shellcheck shell=bash

# What the bpy package needs of the system besides Python.
libraries=(libegl1 libgl1 libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 libxkbcommon0 libxrender1 libxxf86vm1)

fail() {
  echo "$(basename "$0"): $*" >&2
  exit 1
}

python_version() {
  "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true
}

find_python() {
  local candidate
  for candidate in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.11; do
    case $(python_version "$candidate") in
      3.11 | 3.13) echo "$candidate" && return ;;
    esac
  done
  fail "needs Python 3.11 or 3.13; set PYTHON to where it is"
}

install_system_packages() {
  command -v dpkg-query >/dev/null || return 0
  local package missing=()
  for package in "$@"; do
    [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || missing+=("$package")
  done
  ((${#missing[@]})) || return 0
  local prefix=()
  if ((EUID != 0)); then
    prefix=(sudo)
    sudo -n true 2>/dev/null || fail "please install first: sudo apt-get install --no-install-recommends ${missing[*]}"
  fi
  echo "Installing ${missing[*]}" >&2
  "${prefix[@]}" apt-get update -qq >&2
  "${prefix[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null ||
    fail "apt-get could not install ${missing[*]}"
}

prepare_environment() {
  local base version environment bpy needed=("${libraries[@]}")
  base=$(find_python)
  version=$(python_version "$base")
  "$base" -c 'import ensurepip, venv' 2>/dev/null || needed+=("python$version-venv")
  install_system_packages "${needed[@]}"
  case $version in
    3.11) bpy=bpy==${CCDEPTH_BPY:-5.0.1} ;;
    3.13) bpy=bpy==${CCDEPTH_BPY:-5.2.*} ;;
  esac
  environment=$(dirname "${BASH_SOURCE[0]}")/../.venv${CCDEPTH_BPY:+-$CCDEPTH_BPY}
  if [[ $(python_version "$environment/bin/python") != "$version" ]]; then
    "$base" -m venv --clear "$environment"
  fi
  echo "Installing $bpy and what goes with it" >&2
  "$environment/bin/python" -m pip install --quiet --disable-pip-version-check "$bpy" "$@" >&2
  python=$(cd "$environment/bin" && pwd)/python
}
