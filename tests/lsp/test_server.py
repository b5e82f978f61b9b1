"""The editor server, driven as an editor does: over a pair of pipes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

pytest.importorskip("pygls")

LEVER = (Path(__file__).parents[2] / "models" / "lever.bg").read_text()
WRONG = "model M\n  J1 v;  I mass(I = 0);  R damper(R = 1);\nequation\n  v -> mass, damper;\nend M;\n"


class Editor:
    """A client of `bgc lsp`."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "bgdsl", "lsp"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.count = 0
        self.answer = self.ask("initialize", {"processId": None, "rootUri": None, "capabilities": {}})
        self.tell("initialized", {})

    def __enter__(self) -> Editor:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.process.kill()
        self.process.wait()

    def tell(self, method: str, params: Any) -> None:
        self._send({"jsonrpc": "2.0", "method": method, "params": params})

    def ask(self, method: str, params: Any) -> Any:
        self.count += 1
        self._send({"jsonrpc": "2.0", "id": self.count, "method": method, "params": params})
        return next(m for m in self._messages() if m.get("id") == self.count)["result"]

    def _send(self, message: dict[str, Any]) -> None:
        assert self.process.stdin
        body = json.dumps(message).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n" % len(body) + body)
        self.process.stdin.flush()

    def _messages(self) -> Iterator[dict[str, Any]]:
        assert self.process.stdout
        while header := self.process.stdout.readline():
            length = int(header.split(b":")[1])
            while self.process.stdout.readline().strip():
                pass
            yield json.loads(self.process.stdout.read(length))

    def open(self, path: Path, text: str) -> list[dict[str, Any]]:
        self.tell("textDocument/didOpen", {"textDocument": {"uri": path.as_uri(), "languageId": "bg", "version": 1, "text": text}})
        return self.diagnostics(path)

    def change(self, path: Path, text: str) -> list[dict[str, Any]]:
        self.tell("textDocument/didChange", {"textDocument": {"uri": path.as_uri(), "version": 2}, "contentChanges": [{"text": text}]})
        return self.diagnostics(path)

    def diagnostics(self, path: Path) -> list[dict[str, Any]]:
        """The next diagnostics published for a file."""
        published = (m["params"] for m in self._messages() if m.get("method") == "textDocument/publishDiagnostics")
        return next(p["diagnostics"] for p in published if p["uri"] == path.as_uri())

    def about(self, path: Path, method: str, **more: Any) -> Any:
        return self.ask(f"textDocument/{method}", {"textDocument": {"uri": path.as_uri()}, **more})


@pytest.fixture(scope="module")
def editor() -> Iterator[Editor]:
    with Editor() as client:
        yield client


def test_diagnostics_come_and_go(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "m.bg"
    (found,) = editor.open(path, WRONG)
    assert found["code"] == "BG256" and found["source"] == "bgc" and found["severity"] == 1
    assert found["range"]["start"]["line"] == 1
    assert editor.change(path, WRONG.replace("I = 0", "I = 1")) == []


def test_columns_count_as_the_editor_counts(editor: Editor, tmp_path: Path) -> None:
    text = 'model M\n  J1 v "\N{BRIDGE AT NIGHT}";  I mass(I = nothing);  R r(R = 1);\nequation\n  v -> mass, r;\nend M;\n'
    (found,) = editor.open(tmp_path / "wide.bg", text)
    line = text.splitlines()[1]
    assert found["range"]["start"] == {"line": 1, "character": len(line[: line.index("nothing")].encode("utf-16-le")) // 2}


def test_an_error_of_an_imported_file_is_shown(editor: Editor, tmp_path: Path) -> None:
    (tmp_path / "part.bg").write_text("model Part J1 v end Part;")
    found = editor.open(tmp_path / "whole.bg", "import part.Part;\nmodel Whole\n  Part p;\nend Whole;\n")
    assert found and found[0]["range"]["start"] == {"line": 0, "character": 0}
    assert found[0]["relatedInformation"][0]["location"]["uri"] == (tmp_path / "part.bg").as_uri()


def test_formatting(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "f.bg"
    editor.open(path, WRONG.replace("  v -> mass", "v->mass"))
    (edit,) = editor.about(path, "formatting", options={"tabSize": 2, "insertSpaces": True})
    assert "  v -> mass, damper;\n" in edit["newText"]
    assert edit["range"] == {"start": {"line": 0, "character": 0}, "end": {"line": 5, "character": 0}}
    editor.change(path, edit["newText"])
    assert editor.about(path, "formatting", options={"tabSize": 2, "insertSpaces": True}) == []
    editor.change(path, "model")
    assert editor.about(path, "formatting", options={"tabSize": 2, "insertSpaces": True}) is None


def test_the_outline(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "lever.bg"
    assert editor.open(path, LEVER) == []
    (model,) = editor.about(path, "documentSymbol")
    assert model["name"] == "Lever" and model["detail"] == "two mass-spring-dampers coupled by a lever"
    names = [child["name"] for child in model["children"]]
    assert names[:2] == ["mA", "mB"] and "springA" in names and "kick" in names
    editor.change(path, "model M\n  R r[2](each R = 1);\n  redeclare R r[1](R = 2);\nend M;\n")
    (model,) = editor.about(path, "documentSymbol")
    assert [(child["name"], child["detail"]) for child in model["children"]] == [("r", "R"), ("r", "redeclared as R")]


def test_hovering_explains(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "h.bg"
    (wrong,) = editor.open(path, WRONG)
    found = editor.about(path, "hover", position=wrong["range"]["start"])
    assert editor.about(path, "hover", position={"line": 1, "character": 8}) == found, "as anywhere else on the line"
    assert found["contents"]["kind"] == "markdown" and found["contents"]["value"].startswith("# an element's value is zero")
    assert editor.about(path, "hover", position={"line": 0, "character": 0}) is None


def place(text: str, mark: str, after: int = 0) -> dict[str, int]:
    """The position `after` characters behind where `mark` begins."""
    before = text[: text.index(mark) + after]
    return {"line": before.count("\n"), "character": len(before) - before.rfind("\n") - 1}


def test_definitions_are_found(editor: Editor, tmp_path: Path) -> None:
    (tmp_path / "parts.bg").write_text(
        'model Rod "a rod"\n  parameter Real m = 2;\n  I mass(I = m);\n  port in Translational a;\nend Rod;\n'
    )
    text = """import parts.Rod;
model Whole
  parameter Real w = 3;
  Rod rod[2](each m = w);
  J1 v;
  R damper(R = w);
  experiment kick(w = 4, stopTime = 1);
equation
  first: v -> damper;
  v -> rod[1].a, rod[2].a;
end Whole;
test "it runs"
  run r = Whole(w = 2) for 1;
  assert r.rod[1].mass.p < 1;
end;
"""
    path = tmp_path / "whole.bg"
    editor.open(path, text)

    def definition(mark: str, after: int = 0) -> tuple[str, int, int] | None:
        found = editor.about(path, "definition", position=place(text, mark, after))
        return found and (found["uri"].rpartition("/")[2], found["range"]["start"]["line"], found["range"]["start"]["character"])

    own, other = (lambda line, column: ("whole.bg", line, column)), (lambda line, column: ("parts.bg", line, column))
    assert definition("w);\n  J1") == own(2, 17), "a parameter"
    assert definition("Rod rod", 1) == other(0, 6) == definition("Rod;\nmodel"), "a class, by its use and by its import"
    assert definition("m = w") == other(1, 17), "what is modified"
    assert definition("w = 4") == own(2, 17), "what an experiment changes"
    assert definition("rod[1].a") == own(3, 6) and definition("rod[1].a", 7) == other(3, 24), "a component and its member"
    assert definition("damper;") == own(5, 4)
    assert definition("r.rod[1].mass.p") == own(12, 6) and definition("r.rod[1].mass.p", 9) == other(2, 4), "through a run"
    assert definition("w = 2") == own(2, 17) and definition("Whole(w") == own(1, 6)
    assert definition("J1 v") is None and definition("stopTime") is None, "the language's own"


def test_uses_are_found(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "lever.bg"
    editor.open(path, LEVER)
    found = editor.about(path, "references", position=place(LEVER, "massA(I"), context={"includeDeclaration": True})
    places = [(entry["range"]["start"]["line"], entry["range"]["start"]["character"]) for entry in found]
    lines = LEVER.splitlines()
    assert len(places) >= 2 and all(lines[line][column:].startswith("massA") for line, column in places)
    assert [mark["range"] for mark in editor.about(path, "documentHighlight", position=place(LEVER, "massA(I"))] == [
        e["range"] for e in found
    ]


def test_hovering_describes_names(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "lever.bg"
    editor.open(path, LEVER)
    found = editor.about(path, "hover", position=place(LEVER, "mA, f(start"))["contents"]["value"]
    assert 'parameter Real mA(unit = "kg") = 10' in found and "lever.bg:3" in found
    assert "one flow, efforts add up" in editor.about(path, "hover", position=place(LEVER, "J1 vA", 1))["contents"]["value"]
    assert editor.about(path, "hover", position=place(LEVER, "10;")) is None


def test_completion_knows_members_arguments_and_names(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "lever.bg"
    editor.open(path, LEVER)

    def offered(text: str, mark: str) -> dict[str, Any]:
        editor.change(path, text)
        found = editor.about(path, "completion", position=place(text, mark, len(mark)))
        return {item["label"]: item for item in found}

    whole = offered(LEVER, "  vA -> mas")
    assert {"massA", "mA", "kick", "sin", "J1", "model"} <= set(whole) and whole["mA"]["detail"] == 'parameter Real mA(unit = "kg") = 10'
    broken = LEVER.replace("  vA -> massA,", "  output Real x = springA.\n  vA -> massA,").replace("equation", "")
    assert {"q", "e", "f", "power", "energy", "k", "C"} == set(offered(broken, "springA."))
    assert {"I", "p"} <= set(offered(LEVER, "massA(")) and "start" in offered(LEVER, "massA(I = mA, f(st")
    redeclared = (
        "model S\n  parameter Real a;\nend S;\nmodel T\n  parameter Real b;\nend T;\nmodel M\n  S x[2];\n  redeclare T x[1](\nend M;\n"
    )
    assert "b" in offered(redeclared, "x[1](") and "a" not in offered(redeclared, "x[1](")
    assert "a" in offered(redeclared.replace("redeclare T", "redeclare final S"), "x[1](")
    imported = "import mechanics.rotational.Spring;\nmodel M\n  Spring shaft(\nend M;\n"
    assert "J1" in offered(imported, "  Spr") and "k" in offered(imported, "shaft(")
    (tmp_path / "parts.bg").write_text("model Rod J1 v; end Rod;")
    assert {"mechanics", "parts"} <= set(offered("import ", "import "))
    assert set(offered("import parts.\nmodel M end M;", "parts.")) == {"Rod"}
    assert "Spring" in offered("import S = mechanics.rotational.Sp", "rotational.Sp")


def test_broken_text_never_ends_the_server(editor: Editor, tmp_path: Path) -> None:
    path = tmp_path / "broken.bg"
    editor.open(path, "")
    position = {"line": 0, "character": 3}
    broken = [
        "model",
        "\x00",
        "model A end B;",
        '"',
        "/*",
        "((((",
        "test",
        "import ;",
        "\r\n\tmodel M\r\n",
        "}" * 500,
        "model M J1 v; equation v -> ; end M;",
    ]
    for text in [*broken, *(LEVER[:n] for n in range(0, len(LEVER), 97))]:
        editor.change(path, text)
        editor.about(path, "documentSymbol")
        for method in ("hover", "definition", "completion", "documentHighlight"):
            editor.about(path, method, position=position)
        editor.about(path, "formatting", options={"tabSize": 2, "insertSpaces": True})
    assert editor.change(path, LEVER) == []


def test_what_is_offered(editor: Editor) -> None:
    offered = editor.answer["capabilities"]
    assert offered["documentFormattingProvider"] and offered["documentSymbolProvider"] and offered["hoverProvider"]
    assert offered["definitionProvider"] and offered["completionProvider"]["triggerCharacters"] == ["."]


def test_without_pygls_the_command_says_what_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from bgdsl.cli import editor as command
    from bgdsl.cli.app import run

    monkeypatch.setattr(command, "find_spec", lambda name: None)
    assert run(["lsp"]) == 2
    assert "pip install 'bgdsl[lsp]'" in capsys.readouterr().err
