"""How deep text may nest. One number for the lexer's machine, the tree builder and whoever walks the tree by recursion."""

MAX_DEPTH = 200
"""How deep expressions, modifications and statements may nest: far more than is read, far less than Python's stack."""
