"""bgdsl: a textual language for bond graphs, its compiler and its model reducer."""

__version__ = "0.1.0"
