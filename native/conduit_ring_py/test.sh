#!/usr/bin/env bash
# usage: native/conduit_ring_py/test.sh [pytest's arguments]
#
# Builds the Python package conduit_ring and what its tests exchange messages with, installs it in a virtual environment
# below _build, made when it is missing, and runs its tests. Says so and does nothing where Python 3.9 with venv is absent.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

readonly BUILD="$PWD/_build/py"
readonly VENV="$BUILD/venv" PACKAGE="$PWD/native/conduit_ring_py"

main() {
  has_python || { echo "skipped: the Python tests need python3 (3.9 or newer) with venv and pip"; exit 0; }
  make_venv
  build
  export CONDUIT_RING_PEER="$BUILD/cargo/debug/peer" CONDUIT_RING_CAMERA="$PWD/_build/cargo/debug/camera"
  cd "$PACKAGE"
  PYTHONDONTWRITEBYTECODE=1 exec timeout --foreground 600 "$VENV/bin/python" -m pytest "$@"
}

has_python() {
  python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 9))' 2>/dev/null
}

make_venv() {
  "$VENV/bin/python" -c 'import numpy, pytest' 2>/dev/null && [ -x "$VENV/bin/maturin" ] && return
  python3 -m venv --clear "$VENV"
  "$VENV/bin/pip" install --quiet --disable-pip-version-check "maturin>=1.9,<2" pytest numpy
}

build() {
  cargo build --quiet --locked --package camera --manifest-path native/Cargo.toml --target-dir _build/cargo
  (
    cd "$PACKAGE"
    cargo build --quiet --locked --package peer --target-dir "$BUILD/cargo"
    rm -rf "$BUILD/wheels"
    # The variables of an outer virtual environment would lead to another Python.
    env -u VIRTUAL_ENV -u CONDA_PREFIX "$VENV/bin/maturin" build --quiet --profile dev --locked --compatibility linux \
      --interpreter "$VENV/bin/python" --target-dir "$BUILD/cargo" --out "$BUILD/wheels"
  )
  "$VENV/bin/pip" install --quiet --disable-pip-version-check --no-deps --force-reinstall "$BUILD"/wheels/*.whl
}

main "$@"
