"""Loops that have to be fast, written in a restricted Python and compiled to machine code."""
