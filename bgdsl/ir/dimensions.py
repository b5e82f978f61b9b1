"""Units as numbers: exponents of the seven base units of the SI and a factor. The one door to pint.

Unit strings are Modelica's: factors joined by `.`, exponents behind the symbol, `/` before what divides, parentheses
(`kg.m2`, `N.s/m`, `J/(kg.K)`, `m.s-2`, `1`). The symbols of the SI are in a table here, so that ordinary models start without
loading pint; any other symbol, with its prefix, is looked up there, once each. Angles are dimensionless.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

from bgdsl.diagnostics import did_you_mean

BASE = ("kg", "m", "s", "A", "K", "mol", "cd")

Exponents = tuple[Fraction, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Unit:
    """`factor` times the product of the base units to `exponents` (plus `offset` in kelvin, for degC and degF alone).

    Made by `unit` and the functions below, which give equal units one object, so that identity is equality.
    """

    exponents: Exponents
    factor: float = 1.0
    offset: float = 0.0

    @property
    def dimensionless(self) -> bool:
        return not any(self.exponents)

    def __str__(self) -> str:
        return spell(self)


def unit(exponents: Exponents, factor: float = 1.0, offset: float = 0.0) -> Unit:
    """The one object for this unit."""
    return _interned(exponents, factor, offset)


@cache
def _interned(exponents: Exponents, factor: float, offset: float) -> Unit:
    return Unit(exponents, factor, offset)


class UnitError(ValueError):
    """A unit string that says nothing; the message says why."""


def _exponents(**powers: int) -> Exponents:
    return tuple(Fraction(powers.get(name, 0)) for name in BASE)


NUMBER = unit(_exponents())
SECOND = unit(_exponents(s=1))
JOULE = unit(_exponents(kg=1, m=2, s=-2))

SI: Mapping[str, Unit] = {
    **{name: unit(_exponents(**{name: 1})) for name in BASE},
    "1": NUMBER,
    "rad": NUMBER,
    "sr": NUMBER,
    "Hz": unit(_exponents(s=-1)),
    "N": unit(_exponents(kg=1, m=1, s=-2)),
    "Pa": unit(_exponents(kg=1, m=-1, s=-2)),
    "J": JOULE,
    "W": unit(_exponents(kg=1, m=2, s=-3)),
    "C": unit(_exponents(A=1, s=1)),
    "V": unit(_exponents(kg=1, m=2, s=-3, A=-1)),
    "F": unit(_exponents(kg=-1, m=-2, s=4, A=2)),
    "Ohm": unit(_exponents(kg=1, m=2, s=-3, A=-2)),
    "S": unit(_exponents(kg=-1, m=-2, s=3, A=2)),
    "Wb": unit(_exponents(kg=1, m=2, s=-2, A=-1)),
    "T": unit(_exponents(kg=1, s=-2, A=-1)),
    "H": unit(_exponents(kg=1, m=2, s=-2, A=-2)),
}
"""Symbols that need no look-up. A test compares them with pint."""


# --------------------------------------------------------------------------------------------------------------- algebra


@cache
def times(a: Unit, b: Unit) -> Unit:
    """The unit of a product."""
    return unit(tuple(x + y for x, y in zip(a.exponents, b.exponents, strict=True)), a.factor * b.factor)


@cache
def over(a: Unit, b: Unit) -> Unit:
    """The unit of a quotient."""
    return unit(tuple(x - y for x, y in zip(a.exponents, b.exponents, strict=True)), a.factor / b.factor)


@cache
def power(a: Unit, exponent: Fraction) -> Unit:
    """The unit of a power."""
    return unit(tuple(x * exponent for x in a.exponents), float(a.factor ** float(exponent)))


def agree(a: Unit, b: Unit) -> bool:
    """Whether the two measure the same thing on the same scale."""
    return a is b or (a.exponents == b.exponents and abs(a.factor - b.factor) <= 1e-9 * abs(a.factor) and a.offset == b.offset)


# ------------------------------------------------------------------------------------------------------------ from text


_TOKEN = re.compile(r"\s*(?:(?P<symbol>[^\W\d]+|%|°C)(?:(?:\^|\*\*)?(?P<exponent>[+-]?\d+))?|(?P<number>\d+)|(?P<sign>[./*()·]))")


@cache
def parse_unit(text: str) -> Unit:
    """The unit that the text names. UnitError if it names none."""
    if text.strip() == "-":  # as data sheets write it
        return NUMBER
    tokens = _tokens(text)
    position = 0

    def product(closing: bool) -> Unit:
        nonlocal position
        value, divide = factor(), False
        while position < len(tokens):
            sign = tokens[position]
            if sign == ")" and closing:
                break
            if sign not in ("/", "."):
                raise UnitError(f"`.` or `/` is missing in `{text}`")
            divide = sign == "/"
            position += 1
            value = over(value, factor()) if divide else times(value, factor())
        return value

    def factor() -> Unit:
        nonlocal position
        if position >= len(tokens) or isinstance(tokens[position], str):
            if position < len(tokens) and tokens[position] == "(" and tokens.count("(") == tokens.count(")"):
                position += 1
                value = product(closing=True)
                if position < len(tokens):
                    position += 1
                    return value
            raise UnitError(f"`{text}` is not complete")
        token = tokens[position]
        assert isinstance(token, Unit)
        position += 1
        return token

    if len(tokens) > 64:
        raise UnitError("the unit is longer than any unit is")
    return product(closing=False)


def _tokens(text: str) -> list[Unit | str]:
    found: list[Unit | str] = []
    position = 0
    text = text.strip()
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise UnitError(f"`{text[position]}` has no place in a unit")
        position = match.end()
        if symbol := match["symbol"]:
            base, exponent = _symbol(symbol), match["exponent"]
            found.append(power(base, Fraction(int(exponent))) if exponent and abs(int(exponent)) < 100 else base)
        elif number := match["number"]:
            found.append(unit(NUMBER.exponents, float(number)) if number != "1" else NUMBER)
        else:
            found.append({"*": ".", "·": "."}.get(match["sign"], match["sign"]))
    return found


@cache
def _symbol(symbol: str) -> Unit:
    """One symbol with its prefix: from the table, or from pint. `Nm` is refused: what pint takes it for (a count of yarn) nobody means."""
    if symbol in SI:
        return SI[symbol]
    found, product = ask_pint(symbol), _product(symbol)
    if product is not None and product[1] != found.exponents:
        raise UnitError(f"`{symbol}` is no unit{_meant(symbol)}")
    return found


_PREFIXES = frozenset("YZEPTGMkhdcmunpfazy")


def _product(symbol: str) -> tuple[str, Exponents] | None:
    """A symbol as two of the SI written without a sign between them (`Nm`, `kgmm`), and what that would measure."""
    for i in range(1, len(symbol)):
        first, second = symbol[:i], symbol[i:]
        plain = second if second in SI else second[1:] if second[0] in _PREFIXES else ""
        if first in SI and first not in _PREFIXES and plain in SI:
            return f"{first}.{second}", times(SI[first], SI[plain]).exponents
    return None


_SPELLINGS = {"%": "percent", "rev": "turn", "°C": "degC", "Ω": "ohm", "Ohm": "ohm", "l": "liter", "L": "liter"}


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=":auto:", autoconvert_offset_to_baseunit=True)


def _meant(symbol: str) -> str:
    """What somebody may have meant by a symbol that is none."""
    product = _product(symbol)
    if product is not None:
        return f"; a product is written `{product[0]}`"
    return "".join(f"; {text}" for text in did_you_mean(symbol, SI))


def ask_pint(symbol: str) -> Unit:
    """One symbol as pint knows it. UnitError if it does not."""
    import pint

    name = _SPELLINGS.get(symbol) or re.sub("Ohm$", "ohm", symbol)
    try:
        one, zero = (_registry().Quantity(value, name).to_base_units() for value in (1.0, 0.0))
    except (pint.errors.PintError, AttributeError, TypeError, ValueError, KeyError):
        raise UnitError(f"`{symbol}` is no unit{_meant(symbol)}") from None
    names = {"kilogram": 0, "meter": 1, "second": 2, "ampere": 3, "kelvin": 4, "mole": 5, "candela": 6, "radian": -1}
    exponents = [Fraction(0)] * len(BASE)
    for name, exponent in one.unit_items():
        if name not in names:
            raise UnitError(f"`{symbol}` is not built from the units of the SI")
        if names[name] >= 0:
            exponents[names[name]] = Fraction(exponent).limit_denominator(100)
    return unit(tuple(exponents), float(one.magnitude - zero.magnitude), float(zero.magnitude))


# -------------------------------------------------------------------------------------------------------------- to text


_PLEASANT = """
    1 m m/s m/s2 m2 m3 m3/s s 1/s kg N.s/m kg.m kg.m2 kg/m3 N N/m m/N m/(N.s) N.s N/m3 N.s2/m2 N.m N.m.s
    Pa Pa.s Pa/m3 Pa.s/m3 Pa.s2/m3 Pa.s2/m6 m3/Pa W V A C Ohm F H Wb S T V.s/m A/m
    K W/K W/(m.K) W/(m2.K) J/K K/W J/(kg.K) mol mol/s J/mol
"""
"""Unit strings to show for their dimensions; the first of equal ones is taken."""


@cache
def _pleasant() -> Mapping[Exponents, str]:
    texts: dict[Exponents, str] = {}
    for text in _PLEASANT.split():
        texts.setdefault(parse_unit(text).exponents, text)
    return texts


@cache
def spell(value: Unit) -> str:
    """A unit string for the unit, in the SI's own symbols where there is a usual one; a factor stands before it."""
    text = _pleasant().get(value.exponents) or _in_base_units(value.exponents)
    if value.offset:
        return f"{text} (zero at {value.offset:g} K)"
    return text if abs(value.factor - 1.0) <= 1e-9 else f"{value.factor:.10g} {text}"


def _in_base_units(exponents: Exponents) -> str:
    def written(sign: int) -> list[str]:
        pairs = [(name, sign * power) for name, power in zip(BASE, exponents, strict=True) if sign * power > 0]
        return [name if power == 1 else f"{name}{power}" if power.denominator == 1 else f"{name}^({power})" for name, power in pairs]

    above, below = ".".join(written(1)) or "1", written(-1)
    if not below:
        return above
    return f"{above}/{below[0]}" if len(below) == 1 else f"{above}/({'.'.join(below)})"
