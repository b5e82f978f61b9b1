"""`bgc lsp`: an editor server on the same pipeline: diagnostics while typing, formatting, an outline, explanations of codes.

Needs the extra `lsp` (pygls). Speaks the Language Server Protocol on stdin and stdout.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Diagnostic, Label, Reporter
from bgdsl.explanations import explanation
from bgdsl.source import Source, Span
from bgdsl.syntax import ast
from bgdsl.syntax.formatter import format_source
from bgdsl.syntax.parser import parse
from bgdsl.version import VERSION

server: Any = LanguageServer("bgdsl", VERSION)

_SEVERITY = {"error": lsp.DiagnosticSeverity.Error, "warning": lsp.DiagnosticSeverity.Warning}


def _source(uri: str) -> Source:
    path = Path(unquote(urlparse(uri).path))
    return Source(path.name, server.workspace.get_text_document(uri).source, path)


def _range(span: Span) -> lsp.Range:
    (l1, c1), (l2, c2) = span.source.position(span.start), span.source.position(span.end)
    return lsp.Range(lsp.Position(l1 - 1, c1 - 1), lsp.Position(l2 - 1, c2 - 1))


def _related(label: Label) -> lsp.DiagnosticRelatedInformation:
    path = label.span.source.path
    uri = path.absolute().as_uri() if path else f"untitled:{label.span.source.name}"
    return lsp.DiagnosticRelatedInformation(lsp.Location(uri, _range(label.span)), label.text)


def shown(diagnostic: Diagnostic) -> lsp.Diagnostic:
    """A diagnostic as the protocol has it: notes and helps below the message."""
    lines = [diagnostic.message, diagnostic.primary.text, *diagnostic.notes, *(f"help: {text}" for text in diagnostic.helps)]
    return lsp.Diagnostic(
        range=_range(diagnostic.primary.span),
        message="\n".join(line for line in lines if line),
        severity=_SEVERITY[diagnostic.severity],
        code=diagnostic.code.number,
        source="bgc",
        related_information=[_related(label) for label in diagnostic.others],
    )


def _publish(uri: str) -> None:
    source = _source(uri)
    found = [shown(d) for d in pipeline.check_source(source) if d.primary.span.source.name == source.name]
    server.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri=uri, diagnostics=found))


@server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
def opened(params: lsp.DidOpenTextDocumentParams) -> None:
    _publish(params.text_document.uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
def changed(params: lsp.DidChangeTextDocumentParams) -> None:
    _publish(params.text_document.uri)


@server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
def formatting(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
    source = _source(params.text_document.uri)
    report = Reporter()
    try:
        text = format_source(source, report)
        report.stop_if_errors()
    except BgError:
        return None
    return [lsp.TextEdit(_range(Span(source, 0, len(source.text))), text)]


@server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
def symbols(params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol]:
    source = _source(params.text_document.uri)
    tree = parse(source, Reporter())
    kinds = {ast.Model: lsp.SymbolKind.Class, ast.Test: lsp.SymbolKind.Event}
    return [
        lsp.DocumentSymbol(item.name, kinds.get(type(item), lsp.SymbolKind.Function), _range(item.span), _range(item.span))
        for item in tree.items
        if not isinstance(item, ast.Import)
    ]


@server.feature(lsp.TEXT_DOCUMENT_HOVER)
def hover(params: lsp.HoverParams) -> lsp.Hover | None:
    """The explanation of the diagnostic under the pointer."""
    line = params.position.line + 1
    for diagnostic in pipeline.check_source(_source(params.text_document.uri)):
        if diagnostic.primary.span.line == line:
            text = explanation(diagnostic.code.number)
            return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, text)) if text else None
    return None
