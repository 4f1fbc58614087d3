#!/usr/bin/env bash
# usage: native/conduit_ring_py/build.sh
#
# Builds the Python package conduit_ring and installs it in a virtual environment, _build/py/venv, which is made when it is
# missing. That needs python3 (3.9 or newer) with venv and pip, which bin/setup installs, and PyPI.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

readonly BUILD="$PWD/_build/py"
readonly VENV="$BUILD/venv"

main() {
  mkdir -p "$BUILD"
  # One at a time.
  exec 9>"$BUILD/lock"
  flock 9
  has_python || die "the Python package needs python3 (3.9 or newer) with venv and pip; bin/setup installs them on Debian and Ubuntu"
  make_venv
  build
}

die() { echo "conduit_ring_py: $*" >&2; exit 1; }

has_python() {
  python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 9))' 2>/dev/null
}

make_venv() {
  "$VENV/bin/python" -c 'import numpy, pytest' 2>/dev/null && [ -x "$VENV/bin/maturin" ] && return
  python3 -m venv --clear "$VENV"
  "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check "maturin>=1.9,<2" pytest numpy ||
    die "pip could not install maturin, pytest and numpy, without which nothing of Python can be tested; is PyPI reachable?"
}

build() {
  rm -rf "$BUILD/wheels"
  # The variables of an outer virtual environment would lead to another Python.
  (cd native/conduit_ring_py && env -u VIRTUAL_ENV -u CONDA_PREFIX "$VENV/bin/maturin" build --quiet --profile dev --locked \
    --compatibility linux --interpreter "$VENV/bin/python" --target-dir "$BUILD/cargo" --out "$BUILD/wheels")
  "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --force-reinstall "$BUILD"/wheels/*.whl
}

case "${1:-}" in
  "") main ;;
  --help) sed -n '2,/^$/{s/^# \{0,1\}//;p}' "${BASH_SOURCE[0]}" ;;
  *) echo "build.sh takes no argument, got: $*; see --help" >&2; exit 2 ;;
esac
