#!/usr/bin/env bash
# usage: native/conduit_ring_py/build.sh
#
# Builds the Python package conduit_ring and installs it in the virtual environment
# _build/py/venv, which it creates if necessary. Needs PyPI and python3 (3.9 or newer) with venv
# and pip, which bin/setup installs.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

readonly BUILD="$PWD/_build/py"
readonly VENV="$BUILD/venv"

main() {
  mkdir -p "$BUILD"
  # One build at a time.
  exec 9>"$BUILD/lock"
  flock 9
  has_python ||
    die "python3 (3.9 or newer) with venv and pip is missing; run bin/setup to install it"
  make_venv
  build
}

die() { echo "conduit_ring_py: $*" >&2; exit 1; }

has_python() {
  python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 9))' 2>/dev/null
}

make_venv() {
  "$VENV/bin/python" -c 'import numpy, pytest' 2>/dev/null && [ -x "$VENV/bin/maturin" ] &&
    return
  python3 -m venv --clear "$VENV"
  pip install "maturin>=1.9,<2" pytest numpy ||
    die "could not install maturin, pytest and numpy; check that PyPI is reachable"
}

pip() { "$VENV/bin/python" -m pip "$1" --quiet --disable-pip-version-check "${@:2}"; }

build() {
  rm -rf "$BUILD/wheels"
  # The variables of an outer virtual environment would select another Python.
  (
    cd native/conduit_ring_py
    env -u VIRTUAL_ENV -u CONDA_PREFIX "$VENV/bin/maturin" build --quiet --profile dev --locked \
      --compatibility linux --interpreter "$VENV/bin/python" \
      --target-dir "$BUILD/cargo" --out "$BUILD/wheels"
  )
  pip install --no-deps --force-reinstall "$BUILD"/wheels/*.whl
}

case "${1:-}" in
  "") main ;;
  --help) sed -n '2,/^$/{s/^# \{0,1\}//;p}' "${BASH_SOURCE[0]}" ;;
  *) echo "expected no argument, got: $*; see --help" >&2; exit 2 ;;
esac
