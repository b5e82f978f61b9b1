"""Hypothesis runs the same examples every time, so that the suite says the same thing twice about the same code.

To look for new ones: `HYPOTHESIS_PROFILE=search python -m pytest tests/...`; what is found is kept in `.hypothesis` and tried first
the next time.
"""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None, database=None)
settings.register_profile("search", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))
