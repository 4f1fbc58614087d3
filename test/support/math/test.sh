#!/usr/bin/env bash
# usage: test/support/math/test.sh
#
# Computes the cases of reference.terms again with numpy and scipy, in the virtual environment
# _build/math/venv, which it creates if necessary. Needs PyPI and python3 (3.9 or newer) with
# venv and pip, which bin/setup installs.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../../.."

readonly VENV="$PWD/_build/math/venv"

if ! "$VENV/bin/python" -c 'import numpy, scipy' 2>/dev/null; then
  mkdir -p "$(dirname "$VENV")"
  python3 -m venv --clear "$VENV"
  "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check numpy "scipy>=1.11" || {
    echo "math: could not install numpy and scipy; check that PyPI is reachable" >&2
    exit 1
  }
fi

cd test/support/math
PYTHONDONTWRITEBYTECODE=1 exec "$VENV/bin/python" -W error reference.py check reference.terms
