"""The Language Server Protocol on stdin and stdout, on the same pipeline as the commands.

Diagnostics while typing, formatting, an outline; what the name under the pointer stands for, where it is declared, what could be
written next. Imported files are read as they are on disk. Needs the extra `lsp` (pygls).
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Diagnostic, Label, Reporter
from bgdsl.explanations import explanation
from bgdsl.lsp import meaning
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


PAUSE = 0.1
"""Seconds without a change after which a text is checked."""


def _source(uri: str) -> Source:
    path = Path(unquote(urlparse(uri).path))
    return Source(path.name, server.workspace.get_text_document(uri).source, path)


_read: dict[str, meaning.Text] = {}
"""What each open text means, as it was last asked for."""


def _text(uri: str) -> meaning.Text:
    source = _source(uri)
    known = _read.get(uri)
    if known is None or known.source.text != source.text:
        known = _read[uri] = meaning.read(source)
    return known


# -------------------------------------------------------------------------------------------------------------- places


def _position(source: Source, offset: int) -> lsp.Position:
    """A place as the editor counts: lines from 0, columns in the units agreed on at the start (UTF-16 unless said otherwise)."""
    line, column = source.position(offset)
    before = source.text[offset - column + 1 : offset]
    return lsp.Position(line - 1, server.workspace.position_codec.client_num_units(before))


def _offset(source: Source, position: lsp.Position) -> int:
    """The place in the text that the editor means."""
    line = min(position.line, len(source.line_starts) - 1)
    text, left, column = source.line(line + 1), int(position.character), 0
    while left > 0 and column < len(text):
        left -= server.workspace.position_codec.client_num_units(text[column])
        column += 1
    return int(source.line_starts[line] + column)


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


_found: dict[str, tuple[Source, list[Diagnostic]]] = {}
"""What was last found in each open text."""


def _check(uri: str) -> None:
    source = _source(uri)
    diagnostics = pipeline.check_source(source)
    _found[uri] = source, diagnostics
    _publish(uri, [shown(diagnostic, source) for diagnostic in diagnostics])


@server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
def opened(params: lsp.DidOpenTextDocumentParams) -> None:
    _check(params.text_document.uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
async def changed(params: lsp.DidChangeTextDocumentParams) -> None:
    """Checking a large model takes a second: it begins when nothing has been typed for a moment."""
    uri = params.text_document.uri
    text = _source(uri).text
    await asyncio.sleep(PAUSE)
    if uri in server.workspace.text_documents and _source(uri).text == text:
        _check(uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)
def saved(params: lsp.DidSaveTextDocumentParams) -> None:
    """Imported files may have changed on disk: every open document is looked at again."""
    _read.clear()
    for uri in server.workspace.text_documents:
        _check(uri)


@server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
def closed(params: lsp.DidCloseTextDocumentParams) -> None:
    _read.pop(params.text_document.uri, None)
    _found.pop(params.text_document.uri, None)
    _publish(params.text_document.uri, ())


# ----------------------------------------------------------------------------------------------------- formatting, outline


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
    children = list(_members(item)) if isinstance(item, ast.Model) else []
    return _entry(item, _KINDS.get(type(item), lsp.SymbolKind.Function), getattr(item, "comment", None), children)


def _entry(item: Any, kind: lsp.SymbolKind, detail: str | None, children: list[lsp.DocumentSymbol] | None = None) -> lsp.DocumentSymbol:
    """A line of the outline; choosing it leads to the name."""
    return lsp.DocumentSymbol(
        item.name or "unnamed", kind, _range(item.span), _range(_name(item.span, item.name)), detail, children=children
    )


def _name(span: Span, name: str) -> Span:
    """The name within its declaration; all of it where the name is not written there."""
    at = re.search(rf"\b{re.escape(name)}\b", span.text) if name else None
    return Span(span.source, span.start + at.start(), span.start + at.end()) if at else span


def _members(model: ast.Model) -> Iterator[lsp.DocumentSymbol]:
    for item in model.items:
        match item:
            case ast.Declaration(prefixes, type_, declarators):
                kind = lsp.SymbolKind.Constant if {"parameter", "constant"} & set(prefixes) else lsp.SymbolKind.Field
                for declarator in declarators:
                    yield _entry(declarator, kind, declarator.comment or type_.span.text)
            case ast.Redeclaration(type=type_):
                yield _entry(item, lsp.SymbolKind.Field, item.comment or f"redeclared as {type_.span.text}")
            case ast.Experiment():
                yield _entry(item, lsp.SymbolKind.Event, item.comment or "experiment")
            case ast.Model() | ast.ShortFunction() | ast.LongFunction() | ast.TypeDefinition() | ast.Domain():
                yield _symbol(item)


# ------------------------------------------------------------------------------------------------------- names, explanations


@server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
def definition(params: lsp.DefinitionParams) -> lsp.Location | None:
    """Where the name under the pointer is declared, in this file or an imported one."""
    text = _text(params.text_document.uri)
    found = text.at(_offset(text.source, params.position))
    return _location(_name(found[0].span, found[0].name)) if found and found[0].span else None


@server.feature(lsp.TEXT_DOCUMENT_REFERENCES)
def references(params: lsp.ReferenceParams) -> list[lsp.Location]:
    """Where the name under the pointer is used in this file."""
    text = _text(params.text_document.uri)
    return [_location(span) for span in text.uses(_offset(text.source, params.position))]


@server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
def highlight(params: lsp.DocumentHighlightParams) -> list[lsp.DocumentHighlight]:
    """The same, to be marked."""
    text = _text(params.text_document.uri)
    return [lsp.DocumentHighlight(_range(span)) for span in text.uses(_offset(text.source, params.position))]


@server.feature(lsp.TEXT_DOCUMENT_HOVER)
def hover(params: lsp.HoverParams) -> lsp.Hover | None:
    """The explanation of the diagnostic under the pointer; else the declaration of the name there, or what is wrong with the line."""
    uri = params.text_document.uri
    text = _text(uri)
    offset = _offset(text.source, params.position)
    source, diagnostics = _found.get(uri, (text.source, []))
    here = [d for d in diagnostics if d.primary.span.source is source and source.text == text.source.text]
    if under := next((d for d in here if d.primary.span.start <= offset <= d.primary.span.end), None):
        return _explained(under)
    if found := text.at(offset):
        return _shown(_described(found[0]), found[1])
    beside = next((d for d in here if d.primary.span.line == params.position.line + 1), None)
    return _explained(beside) if beside else None


def _explained(diagnostic: Diagnostic) -> lsp.Hover | None:
    page = explanation(diagnostic.code.number)
    return _shown(page, diagnostic.primary.span) if page else None


def _shown(text: str, span: Span) -> lsp.Hover:
    return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, text), _range(span))


def _described(named: meaning.Named) -> str:
    lines = [f"```bg\n{named.shown}\n```"]
    if named.comment and named.comment not in named.shown:
        lines.append(named.comment)
    if named.span:
        lines.append(f"*{named.span.source.name}:{named.span.line}*")
    return "\n\n".join(lines)


_ROLES: dict[meaning.Role, lsp.CompletionItemKind] = {
    "module": lsp.CompletionItemKind.Module,
    "class": lsp.CompletionItemKind.Class,
    "function": lsp.CompletionItemKind.Function,
    "type": lsp.CompletionItemKind.TypeParameter,
    "parameter": lsp.CompletionItemKind.Constant,
    "component": lsp.CompletionItemKind.Field,
    "experiment": lsp.CompletionItemKind.Event,
    "bond": lsp.CompletionItemKind.Reference,
    "run": lsp.CompletionItemKind.Variable,
    "variable": lsp.CompletionItemKind.Variable,
    "keyword": lsp.CompletionItemKind.Keyword,
}


@server.feature(lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=["."]))
def completion(params: lsp.CompletionParams) -> list[lsp.CompletionItem]:
    """What could be written at the pointer; the editor picks what begins like the word there."""
    text = _text(params.text_document.uri)
    found = text.completions(_offset(text.source, params.position))
    return [
        lsp.CompletionItem(named.name, kind=_ROLES[named.role], detail=_line(named.shown), documentation=named.comment) for named in found
    ]


def _line(text: str) -> str:
    return text.partition("\n")[0]
