"""Polynomials in x, y and z written as text, or as a sympy.Poly, read exactly.

The grammar; ^ and ** are synonyms, powers bind tighter than a sign before them and to the right:

    sum     = product (("+" | "-") product)*
    product = signed (("*" | "/") signed)*
    signed  = ("+" | "-") signed | power
    power   = (number | "x" | "y" | "z" | "(" sum ")") (("**" | "^") signed)?

Numbers are decimal, 0.1 is one tenth. Nothing is evaluated as code.
"""

import re
from fractions import Fraction
from typing import Any

import numpy as np

# Terms by their exponents.
Terms = dict[tuple[int, int, int], Fraction]

_TOKENS = re.compile(r"\s*(?:((?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\*\*|[-+*/^()]))", re.ASCII)
_VARIABLES = ("x", "y", "z")
# A dense array of this degree has 36 000 coefficients; larger exponents of ten exceed all doubles; numbers of
# more bits come from powers of powers, which would fill the memory.
_LARGEST_DEGREE, _LARGEST_EXPONENT, _LARGEST_BITS, _DEEPEST = 32, 400, 50_000, 40
# Most products of coefficients, some seconds of work: a constant, and a number for each character.
_MOST_PRODUCTS = 1_000_000


class PolynomialError(ValueError):
    """Text that is not a polynomial in x, y and z; the message starts with the column, from 1.

    Args:
        message: names the wrong text, and the text needed instead.
        column: column in the text, from 1.
    """

    def __init__(self, message: str, column: int):
        self.column = column
        self.reason = message
        super().__init__(f"column {column}: {message}")


def read(text: str) -> Terms:
    """The terms of the polynomial, exact, none of them zero.

    >>> read("(x - 1/2)^2")
    {(2, 0, 0): Fraction(1, 1), (1, 0, 0): Fraction(-1, 1), (0, 0, 0): Fraction(1, 4)}

    Raises:
        PolynomialError: other names, calls, a divisor that is no constant or zero, an exponent that is no whole number
            from 0 to 32, a degree above 32, or anything outside the grammar.
    """
    reader = _Reader(text)
    terms = reader.sum()
    if reader.token != "":
        raise reader.error("an operator")
    return terms


def from_sympy(polynomial: Any) -> Terms:
    """The terms of a `sympy.Poly` in some of x, y and z: rational coefficients exactly, others as doubles.

    Raises:
        TypeError: another object.
        ValueError: other generators, or coefficients that are no real numbers.
    """
    if not (hasattr(polynomial, "gens") and callable(getattr(polynomial, "terms", None))):
        raise TypeError(f"polynomial must be text or a sympy.Poly in x, y and z; got {type(polynomial).__name__}.")
    names = [str(gen) for gen in polynomial.gens]
    if not set(names) <= set(_VARIABLES):
        raise ValueError(f"polynomial has the generators {', '.join(names)}; needs some of x, y and z.")
    result: Terms = {}
    for powers, number in polynomial.terms():
        power = dict(zip(names, powers, strict=True))
        result[(*(int(power.get(name, 0)) for name in _VARIABLES),)] = _number(number)  # pyright: ignore
    return {index: x for index, x in result.items() if x != 0}


def written(coefficients: np.ndarray) -> str:
    """A polynomial as text that `read` takes, highest powers first, with six digits of each coefficient.

    >>> written(np.array([[[-1.0, 0.0, 2.0]], [[0.0, 1.0, 0.0]]]))
    'x*z + 2*z**2 - 1'
    """
    text = ""
    for index in sorted(zip(*np.nonzero(coefficients), strict=True), key=lambda i: (-sum(i), tuple(-n for n in i))):
        x = float(coefficients[index])
        powers = [f"{name}**{n}" if n > 1 else name for name, n in zip("xyz", index, strict=True) if n]
        factors = [f"{abs(x):.6g}"] if abs(x) != 1 or not powers else []
        sign = (" - " if x < 0 else " + ") if text else ("-" if x < 0 else "")
        text += sign + "*".join(factors + powers)
    return text


def _number(number: Any) -> Fraction:
    if getattr(number, "is_Rational", False):
        return Fraction(int(number.p), int(number.q))
    try:
        return Fraction(float(number))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"polynomial has the coefficient {number}; needs real numbers.") from None


class _Reader:
    """Recursive descent parser; `token` is the next token, "" at the end, and `start` its position."""

    def __init__(self, text: str):
        self.text, self.position, self.depth = text, 0, 0
        self.left = _MOST_PRODUCTS + 10 * len(text)
        self.token, self.start, self.number = "", 0, False
        self.advance()

    def advance(self) -> None:
        match = _TOKENS.match(self.text, self.position)
        if match:
            number, name, operator = match.groups()
            self.token, self.number = number or name or operator, number is not None
            self.start, self.position = match.end() - len(self.token), match.end()
            return
        rest = self.text[self.position :]
        self.start = self.position + len(rest) - len(rest.lstrip())
        self.token, self.number, self.position = self.text[self.start : self.start + 1], False, len(self.text)
        if self.token:
            raise self.error("a number, x, y, z, an operator or a parenthesis")

    def error(self, needed: str) -> PolynomialError:
        found = repr(self.token[:40]) if self.token else "the end"
        if self.token == "=":
            found += ", but f = g is written f - (g)"
        return PolynomialError(f"found {found}; needs {needed}.", self.start + 1)

    def take(self, *tokens: str) -> str:
        """Consume and return the next token if it is one of these; else return an empty text."""
        token = self.token if self.token in tokens and not self.number else ""
        if token:
            self.advance()
        return token

    def spend(self, products: int, place: int) -> None:
        """Count products of coefficients before they are computed, up to the limit."""
        self.left -= products
        if self.left < 0:
            raise PolynomialError("the products of sums have too many terms for a text of this length.", place + 1)

    def sum(self) -> Terms:
        terms = self.product()
        while sign := self.take("+", "-"):
            for index, x in self.product().items():
                terms[index] = terms.get(index, Fraction(0)) + (x if sign == "+" else -x)
        return {index: x for index, x in terms.items() if x != 0}

    def product(self) -> Terms:
        terms = self.signed()
        while operator := self.take("*", "/"):
            place = self.start
            other = self.signed()
            if operator == "*":
                terms = self.multiplied(terms, other, place)
                continue
            divisor = _constant(other)
            if not divisor:
                raise PolynomialError(f"the divisor is {'zero' if divisor == 0 else 'no constant'}.", place + 1)
            self.spend(4 * len(terms), place)  # the time that divisions take
            terms = {index: x / divisor for index, x in terms.items()}
        return terms

    def signed(self) -> Terms:
        self.depth += 1
        if self.depth > _DEEPEST:
            raise PolynomialError(f"parentheses, signs or powers are nested deeper than {_DEEPEST}.", self.start + 1)
        sign = self.take("+", "-")
        terms = self.signed() if sign else self.power()
        self.depth -= 1
        if sign:
            self.spend(len(terms), self.start)
        return {index: -x for index, x in terms.items()} if sign == "-" else terms

    def power(self) -> Terms:
        base = self.atom()
        place = self.start
        if not self.take("**", "^"):
            return base
        place = self.start
        exponent = _constant(self.signed())
        if exponent is None or exponent.denominator != 1 or not 0 <= exponent <= _LARGEST_DEGREE:
            found = "no constant" if exponent is None else _shown(exponent)
            raise PolynomialError(
                f"the exponent is {found}; needs a whole number from 0 to {_LARGEST_DEGREE}.", place + 1
            )
        result = {(0, 0, 0): Fraction(1)}
        for _ in range(int(exponent)):
            result = self.multiplied(result, base, place)
        return result

    def atom(self) -> Terms:
        token, place = self.token, self.start
        if self.number:
            self.advance()
            return _terms((0, 0, 0), _decimal(token, place))
        if token in _VARIABLES:
            self.advance()
            return {(*(int(token == name) for name in _VARIABLES),): Fraction(1)}  # pyright: ignore[reportReturnType]
        if not self.take("("):
            raise self.error("a number, x, y, z or an opening parenthesis")
        terms = self.sum()
        if not self.take(")"):
            raise self.error("an operator or a closing parenthesis")
        return terms

    def multiplied(self, f: Terms, g: Terms, place: int) -> Terms:
        degree = sum(max((sum(index) for index in terms), default=0) for terms in (f, g))
        if degree > _LARGEST_DEGREE:
            raise PolynomialError(f"the degree is {degree}; at most {_LARGEST_DEGREE} is supported.", place + 1)
        self.spend(len(f) * len(g), place)
        result: Terms = {}
        for (a, b, c), x in f.items():
            for (d, e, h), y in g.items():
                index = a + d, b + e, c + h
                result[index] = result.get(index, Fraction(0)) + x * y
        if any(max(x.numerator.bit_length(), x.denominator.bit_length()) > _LARGEST_BITS for x in result.values()):
            raise PolynomialError(f"a number of more than {_LARGEST_BITS} bits is outside the range.", place + 1)
        return {index: x for index, x in result.items() if x != 0}


def _decimal(token: str, place: int) -> Fraction:
    exponent = re.split("[eE]", token)[1:]
    if exponent and (len(exponent[0]) > 9 or abs(int(exponent[0])) > _LARGEST_EXPONENT):
        raise PolynomialError(f"{token[:40]} is outside the range of doubles.", place + 1)
    if len(token) > 10 * _LARGEST_EXPONENT:
        raise PolynomialError(f"a number of {len(token)} characters is outside the range of doubles.", place + 1)
    return Fraction(token)


def _shown(x: Fraction) -> str:
    # Numbers with more bits are not printed in messages.
    long = max(x.numerator.bit_length(), x.denominator.bit_length()) > 100
    return "a number of very many digits" if long else str(x)


def _terms(index: tuple[int, int, int], x: Fraction) -> Terms:
    return {index: x} if x else {}


def _constant(terms: Terms) -> Fraction | None:
    """The value of a constant polynomial; None if the polynomial is not constant."""
    return terms.get((0, 0, 0), Fraction(0)) if set(terms) <= {(0, 0, 0)} else None
