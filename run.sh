#!/usr/bin/env bash
# Set up bgdsl in a virtual environment of its own and run the main job: the lever of the paper, from text to partitions.
set -euo pipefail
cd "$(dirname "$0")"
python3 -m venv .cache/venv
.cache/venv/bin/pip install --quiet --disable-pip-version-check -e .
export PATH="$PWD/.cache/venv/bin:$PATH"
set -x
bgc activity models/lever_stiff.bg --experiment kick
bgc condition models/lever_stiff.bg --experiment kick --threshold 2.5% -o .cache/lever_conditioned.bg --force
bgc show .cache/lever_conditioned.bg --what equations
bgc partition models/lever_stiff.bg --experiment kick --threshold 2.5% -o .cache/lever --force
