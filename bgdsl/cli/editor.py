"""`bgc lsp`: the editor server."""

from __future__ import annotations

from importlib.util import find_spec

from bgdsl.cli.app import app
from bgdsl.cli.console import RefusedError


@app.command("lsp")
def serve() -> int:
    """Serve an editor on stdin and stdout (Language Server Protocol): diagnostics, completion, definitions, formatting, outline."""
    if find_spec("pygls") is None:
        raise RefusedError("the editor server needs pygls: pip install 'bgdsl[lsp]'")
    from bgdsl.lsp.server import serve as run

    run()
    return 0
