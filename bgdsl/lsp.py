"""`bgc lsp`: an editor server on the same pipeline: diagnostics while typing, formatting, an outline, explanations of codes.

Needs the extra `lsp` (pygls). Speaks the Language Server Protocol on stdin and stdout.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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


def serve() -> None:
    """Serve on stdin and stdout until the editor says exit."""
    server.start_io()


def _source(uri: str) -> Source:
    path = Path(unquote(urlparse(uri).path))
    return Source(path.name, server.workspace.get_text_document(uri).source, path)


# -------------------------------------------------------------------------------------------------------------- places


def _position(source: Source, offset: int) -> lsp.Position:
    """A place as the editor counts: lines from 0, columns in the units agreed on at the start (UTF-16 unless said otherwise)."""
    line, column = source.position(offset)
    before = source.text[offset - column + 1 : offset]
    return lsp.Position(line - 1, server.workspace.position_codec.client_num_units(before))


def _range(span: Span) -> lsp.Range:
    return lsp.Range(_position(span.source, span.start), _position(span.source, span.end))


def _location(span: Span) -> lsp.Location:
    path = span.source.path
    return lsp.Location(path.absolute().as_uri() if path else f"untitled:{span.source.name}", _range(span))


# --------------------------------------------------------------------------------------------------------- diagnostics


def shown(diagnostic: Diagnostic, source: Source) -> lsp.Diagnostic:
    """A diagnostic as the protocol has it: notes and helps below the message. One of an imported file stands at the top."""
    here = diagnostic.primary.span.source is source
    lines = [diagnostic.message, diagnostic.primary.text, *diagnostic.notes, *(f"help: {text}" for text in diagnostic.helps)]
    elsewhere = () if here else (Label(diagnostic.primary.span, diagnostic.message),)
    return lsp.Diagnostic(
        range=_range(diagnostic.primary.span if here else Span(source, 0, 0)),
        message="\n".join(line for line in lines if line),
        severity=_SEVERITY[diagnostic.severity],
        code=diagnostic.code.number,
        source="bgc",
        related_information=[
            lsp.DiagnosticRelatedInformation(_location(label.span), label.text) for label in (*elsewhere, *diagnostic.others)
        ],
    )


def _publish(uri: str, diagnostics: Iterable[lsp.Diagnostic]) -> None:
    server.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri=uri, diagnostics=list(diagnostics)))


def _check(uri: str) -> None:
    source = _source(uri)
    _publish(uri, [shown(diagnostic, source) for diagnostic in pipeline.check_source(source)])


@server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
def opened(params: lsp.DidOpenTextDocumentParams) -> None:
    _check(params.text_document.uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
def changed(params: lsp.DidChangeTextDocumentParams) -> None:
    _check(params.text_document.uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)
def saved(params: lsp.DidSaveTextDocumentParams) -> None:
    """Imported files may have changed on disk: every open document is looked at again."""
    for uri in server.workspace.text_documents:
        _check(uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
def closed(params: lsp.DidCloseTextDocumentParams) -> None:
    _publish(params.text_document.uri, ())


# ----------------------------------------------------------------------------------------- formatting, outline, hovering


@server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
def formatting(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
    """The canonical layout; nothing while the text cannot be parsed."""
    source = _source(params.text_document.uri)
    report = Reporter()
    try:
        text = format_source(source, report)
        report.stop_if_errors()
    except BgError:
        return None
    return [] if text == source.text else [lsp.TextEdit(_range(Span(source, 0, len(source.text))), text)]


_KINDS = {ast.Model: lsp.SymbolKind.Class, ast.Test: lsp.SymbolKind.Event, ast.TypeDefinition: lsp.SymbolKind.TypeParameter}


@server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
def symbols(params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol]:
    """The definitions of a file, models with their components, parameters and experiments; what could be read of a broken one."""
    try:
        tree = parse(_source(params.text_document.uri), Reporter())
    except BgError:
        return []
    return [_symbol(item) for item in tree.items if not isinstance(item, ast.Import)]


def _symbol(item: Any) -> lsp.DocumentSymbol:
    place = _range(item.span)
    children = list(_members(item)) if isinstance(item, ast.Model) else []
    kind = _KINDS.get(type(item), lsp.SymbolKind.Function)
    return lsp.DocumentSymbol(item.name or "unnamed", kind, place, place, detail=getattr(item, "comment", None), children=children)


def _members(model: ast.Model) -> Iterator[lsp.DocumentSymbol]:
    for item in model.items:
        match item:
            case ast.Declaration(prefixes, type_, declarators):
                kind = lsp.SymbolKind.Constant if {"parameter", "constant"} & set(prefixes) else lsp.SymbolKind.Field
                for declarator in declarators:
                    place = _range(declarator.span)
                    detail = declarator.comment or type_.span.text
                    yield lsp.DocumentSymbol(declarator.name, kind, place, place, detail=detail)
            case ast.Experiment():
                place = _range(item.span)
                yield lsp.DocumentSymbol(item.name, lsp.SymbolKind.Event, place, place, detail=item.comment or "experiment")
            case ast.Model() | ast.ShortFunction() | ast.LongFunction() | ast.TypeDefinition() | ast.Domain():
                yield _symbol(item)


@server.feature(lsp.TEXT_DOCUMENT_HOVER)
def hover(params: lsp.HoverParams) -> lsp.Hover | None:
    """The explanation of the diagnostic on the line of the pointer, of the one under it first."""
    source = _source(params.text_document.uri)
    line = params.position.line
    near = [d for d in pipeline.check_source(source) if d.primary.span.source is source and _spans(_range(d.primary.span), line)]
    if not near:
        return None
    chosen = min(near, key=lambda d: not _under(params.position, _range(d.primary.span)))
    text = explanation(chosen.code.number)
    return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, text), _range(chosen.primary.span)) if text else None


def _spans(place: lsp.Range, line: int) -> bool:
    return bool(place.start.line <= line <= place.end.line)


def _under(position: lsp.Position, place: lsp.Range) -> bool:
    return bool(place.start <= position <= place.end)
