"""`bgc lsp`: what an editor asks of a language server. `server` speaks the protocol, `meaning` knows what names stand for.

Needs the extra `lsp` (pygls); nothing of it is imported here.
"""
