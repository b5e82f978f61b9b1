"""Program -> machine code, by LLVM."""

from bgdsl.backends.native.model import NativeKernel, NativeModel, build

__all__ = ["NativeKernel", "NativeModel", "build"]
