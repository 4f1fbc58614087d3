#!/usr/bin/env bash
# Usage: native/languages/build.sh
#
# Builds the peers: the programs `rust` and `cpp` in _build/languages, and the virtual environment
# for peer.py (native/conduit_ring_py/build.sh).

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

readonly TO=_build/languages
mkdir -p "$TO"

(
  cd native
  cargo build --locked --quiet --package languages --package conduit_ring_c \
    --target-dir ../_build/cargo
)
cp "_build/cargo/debug/languages" "$TO/rust.new"
"${CXX:-c++}" -std=c++17 -O1 -Wall -Wextra -Werror -pthread -I native/conduit_ring_c/include \
  native/languages/peer.cpp "_build/cargo/debug/libconduit_ring_c.a" -ldl -lm -o "$TO/cpp.new"
# A rename replaces programs that are running.
mv "$TO/rust.new" "$TO/rust"
mv "$TO/cpp.new" "$TO/cpp"
native/conduit_ring_py/build.sh
