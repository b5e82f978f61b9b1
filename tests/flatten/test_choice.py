"""Which model of a file is meant."""

from __future__ import annotations

import pytest

from bgdsl.diagnostics import BgError

ONE = "model {0}\n J1 v; I m(I = 1); Se s(e = 1);\nequation\n s -> v; v -> m;\nend {0};\n"


def test_the_only_one(flat) -> None:
    assert flat(ONE.format("A")).model == "A"


def test_the_one_that_no_other_uses(flat) -> None:
    assert flat(ONE.format("A") + "model B\n A a;\nend B;\nmodel Top\n extends B;\nend Top;\n").model == "Top"


def test_several_are_listed(flat) -> None:
    with pytest.raises(BgError, match="2 models that no other uses") as error:
        flat(ONE.format("A") + ONE.format("B"))
    assert error.value.diagnostics[0].code.number == "BG609"
    assert "`A`, `B`" in error.value.diagnostics[0].notes[0]


def test_none_and_misspelt(flat) -> None:
    with pytest.raises(BgError, match="has no model"):
        flat("function f(x) = x;")
    with pytest.raises(BgError, match="did you mean `Lever`"):
        flat(ONE.format("Lever"), "Levr")
