#!/usr/bin/env bash
# Set up a virtual environment of its own and pass every check: style, types, floors, tests.
set -euo pipefail
cd "$(dirname "$0")"
python3 -m venv .cache/test-venv
.cache/test-venv/bin/pip install --quiet --disable-pip-version-check -e '.[dev]'
export PATH="$PWD/.cache/test-venv/bin:$PATH" BGDSL_CACHE="$PWD/.cache/bgdsl"
ruff check .
ruff format --check .
mypy
lint-imports
bgc fmt --check models bgdsl/library
python -m pytest -n 2 "$@"
