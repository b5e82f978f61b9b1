"""Unit strings: the table of the SI agrees with pint, Modelica's spellings are read, nonsense is refused."""

import subprocess
import sys

import pytest

from bgdsl.ir.dimensions import BASE, NUMBER, SI, UnitError, agree, ask_pint, over, parse_unit, spell, times


@pytest.mark.parametrize("symbol", [symbol for symbol in SI if symbol != "1"])
def test_the_table_is_what_pint_says(symbol):
    assert agree(SI[symbol], ask_pint(symbol))


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("N.m", "J"), ("kg.m2/s2", "J"), ("N.s/m", "kg/s"), ("N.m.s/rad", "N.m.s"), ("W/(m2.K)", "kg/(s3.K)"), ("m.s-2", "m/s2"),
        ("V.A", "W"), ("rad/s", "1/s"),
        ("Hz", "s-1"), ("J/kg/K", "J/(kg.K)"), ("((N))/m", "N/m"), ("kOhm.mA", "V"), ("l/min", "1/(60000.s/m3)"),
    ],
)  # fmt: skip
def test_units_that_are_the_same(text, same):
    assert agree(parse_unit(text), parse_unit(same))


@pytest.mark.parametrize(
    ("text", "factor"),
    [("mm", 1e-3), ("km/h", 1 / 3.6), ("bar", 1e5), ("kW", 1e3), ("deg", 0.017453292519943295), ("%", 0.01), ("rpm", 0.10471975511965977)],
)
def test_factors(text, factor):
    assert parse_unit(text).factor == pytest.approx(factor, rel=1e-12)


def test_degrees_celsius_are_not_kelvin():
    assert parse_unit("degC").exponents == parse_unit("K").exponents
    assert not agree(parse_unit("degC"), parse_unit("K"))


@pytest.mark.parametrize(
    "text", ["", " ", "N m", "N..m", "(N", "N)", "N/", "/s", "foo", "Newton metre", "€", "kg2.", "m^", ".".join(["m"] * 100)]
)
def test_nonsense_is_refused(text):
    with pytest.raises(UnitError):
        parse_unit(text)


@pytest.mark.parametrize(("text", "product"), [("Nm", "N.m"), ("Nms", "N.ms"), ("rads", "rad.s"), ("Ws/K", "W.s"), ("kgm2", "kg.m")])
def test_products_written_together_are_not_what_pint_finds_in_them(text, product):
    with pytest.raises(UnitError, match=f"a product is written `{product}`"):
        parse_unit(text)


def test_a_misspelt_unit_has_a_neighbour():
    with pytest.raises(UnitError, match="did you mean `kg`"):
        parse_unit("kgg")


def test_algebra_and_spelling():
    assert spell(over(parse_unit("N"), parse_unit("m"))) == "N/m"
    assert spell(times(parse_unit("N"), parse_unit("m"))) == "N.m"
    assert spell(NUMBER) == "1"
    assert spell(parse_unit("kg.m5/s4")) == "kg.m5/s4"
    assert all(agree(parse_unit(spell(SI[name])), SI[name]) for name in BASE)


def test_ordinary_units_do_not_load_pint():
    code = "import sys; from bgdsl.ir.dimensions import parse_unit; parse_unit('kg.m2/(s.K)'); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
