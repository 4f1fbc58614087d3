#!/usr/bin/env bash
# usage: native/conduit_ring_py/test.sh [arguments for pytest]
#
# Builds the Python package conduit_ring (build.sh) and the peers of its tests, and runs the
# tests.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

readonly BUILD="$PWD/_build/py"

native/conduit_ring_py/build.sh
cargo build --quiet --locked --package camera \
  --manifest-path native/Cargo.toml --target-dir _build/cargo
cargo build --quiet --locked --package peer \
  --manifest-path native/conduit_ring_py/Cargo.toml --target-dir "$BUILD/cargo"
export CONDUIT_RING_PEER="$BUILD/cargo/debug/peer"
export CONDUIT_RING_CAMERA="$PWD/_build/cargo/debug/camera"
cd native/conduit_ring_py
PYTHONDONTWRITEBYTECODE=1 exec timeout --foreground 3600 "$BUILD/venv/bin/python" -m pytest "$@"
