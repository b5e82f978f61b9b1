"""Runs: from a compiled model and options to a trajectory."""
