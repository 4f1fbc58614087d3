#!/usr/bin/env bash
# usage: native/conduit_ring_c/install.sh --prefix DIR [--built DIR]
#
# Installs the ring for C and C++ in DIR: include/, lib/libconduit_ring.so.2 and .a,
# lib/pkgconfig/ and lib/cmake/.
#   --prefix DIR   the folder to install in, below DESTDIR if the environment has it; the
#                  installation may be moved later
#   --built DIR    a folder with libconduit_ring_c.so and .a; by default cargo builds them
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
readonly here SONAME=libconduit_ring.so.2

help() { sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "${BASH_SOURCE[0]}"; }
usage_error() { echo "$1; see --help" >&2; exit 2; }

prefix='' built=''
while [ $# -gt 0 ]; do
  case "$1" in
    --help) help; exit 0 ;;
    --prefix | --built)
      [ $# -ge 2 ] || usage_error "invalid value for $1: expected a folder, got: no value" ;;
    *) usage_error "unknown option $1; expected one of: --prefix DIR, --built DIR" ;;
  esac
  case "$1" in
    --prefix) prefix=$2 ;;
    --built) built=$2 ;;
  esac
  shift 2
done
[ -n "$prefix" ] || usage_error "--prefix is missing; expected a folder"

if [ -z "$built" ]; then
  target_dir=$(realpath -m "${CARGO_TARGET_DIR:-$here/../../_build/cargo}")
  (
    cd "$here/.."
    cargo build --locked --release --package conduit_ring_c --target-dir "$target_dir"
  )
  built=$target_dir/release
fi

readonly PACKAGE='/^\[workspace\.package\]/,/^\[/'
version=$(sed -n "$PACKAGE"'s/^version = "\(.*\)"/\1/p' "$here/../Cargo.toml")
to=${DESTDIR:-}$prefix
fill_in() { sed "s/@VERSION@/$version/g" "$1"; }

install -d "$to/include/conduit_core/detail" "$to/lib/pkgconfig"
install -d "$to/lib/cmake/conduit_ring" "$to/lib/cmake/conduit_core"
install -m 644 "$here"/include/conduit_ring.h "$to/include/"
install -m 644 "$here"/include/conduit_core/*.hpp "$to/include/conduit_core/"
install -m 644 "$here"/include/conduit_core/detail/*.hpp "$to/include/conduit_core/detail/"
install -m 755 "$built/libconduit_ring_c.so" "$to/lib/$SONAME"
ln -sf "$SONAME" "$to/lib/libconduit_ring.so"
install -m 644 "$built/libconduit_ring_c.a" "$to/lib/libconduit_ring.a"
fill_in "$here/conduit_ring.pc.in" >"$to/lib/pkgconfig/conduit_ring.pc"
install -m 644 "$here"/cmake/conduit_ring-{config,targets}.cmake "$to/lib/cmake/conduit_ring/"
install -m 644 "$here/cmake/conduit_core-config.cmake" "$to/lib/cmake/conduit_core/"
for package in conduit_ring conduit_core; do
  fill_in "$here/cmake/conduit_ring-config-version.cmake.in" \
    >"$to/lib/cmake/$package/$package-config-version.cmake"
done
