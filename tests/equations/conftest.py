"""Puts the oracles of this folder on the import path of its tests, and of those of tests/physics."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
