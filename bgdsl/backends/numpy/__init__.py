"""Program -> a standalone Python module that needs NumPy only."""

from bgdsl.backends.numpy.module import write_module

__all__ = ["write_module"]
