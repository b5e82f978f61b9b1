"""`bgc`, the command line: arguments, progress, tables and exit statuses; the work is done by `bgdsl.pipeline`.

Exit status: 0 done; 1 done, and something was found; 2 could not be done.
"""

from __future__ import annotations

import gc
import os
import sys


def main() -> None:
    """The console script. Never ends in a traceback for a user's mistake; `--debug` shows it."""
    gc.disable()  # trees and graphs are long-lived, and looking through them for cycles costs more than compiling them
    from bgdsl.cli.app import run

    try:
        status = run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output has gone (`bgc show ... | head`)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 2
    sys.exit(status)
