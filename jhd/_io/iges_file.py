"""The layout of an IGES file: lines of 80 columns in five sections, directory entries, and records of parameters.

We read the fixed format of IGES 5.3 (US PRO/IPO-100, 1996), section 2.2: columns 1 to 72 hold data, column 73 the
letter of the section, columns 74 to 80 the number of the line in its section. The compressed and the binary format are
refused. Every line is visited a fixed number of times, and no number in the file determines how much memory is
allocated.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

from jhd._io.errors import ParseError, shown

_SECTIONS = "SGDPT"
_NAMES = {"S": "start", "G": "global", "D": "directory", "P": "parameter", "T": "terminate"}
_WIDTH, _FIELD, _PARAMETERS = 80, 8, 64
_INTEGER = re.compile(r"[+-]?[0-9]{1,10}", re.ASCII)
_REAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[EDed][+-]?[0-9]{1,4})?", re.ASCII)
# Unit flags of the global section (2.2.4.3.14) and millimeters, by the names of the units (2.2.4.3.15).
UNITS = {
    "IN": (1, 25.4), "MM": (2, 1.0), "FT": (4, 304.8), "MI": (5, 1609344.0), "M": (6, 1000.0), "KM": (7, 1e6),
    "MIL": (8, 0.0254), "UM": (9, 0.001), "CM": (10, 10.0), "UIN": (11, 2.54e-5),
}  # fmt: skip
# Positions of the scale of the model, the flag and the name of the unit in the global section, from 0.
_SCALE, _FLAG, _NAME = 12, 13, 14
# Characters of numbers and strings cannot be delimiters (IGES 5.3, section 2.2.4.2).
_NO_DELIMITERS = frozenset("0123456789+-.DEH ")


class IgesLine(NamedTuple):
    """The data of a line, columns 1 to 72, and its number in the file."""

    text: str
    number: int


class IgesEntry(NamedTuple):
    """A directory entry (IGES 5.3, section 2.2.4.4): two lines of ten fields, as far as they are of use."""

    line: int
    sequence: int
    type: int
    form: int
    matrix: int
    blanked: bool
    dependent: bool
    use: int
    first: int
    count: int


class IgesFile(NamedTuple):
    """Content of a file: words of the global section, entries by sequence numbers, parameters and delimiters."""

    name: object
    line: int
    header: Sequence[str]
    entries: dict[int, IgesEntry]
    parameters: Sequence[IgesLine]
    delimiters: tuple[str, str]

    def unit(self) -> str:
        """The unit of the coordinates, one of `UNITS`.

        Raises:
            ParseError: another unit, a flag and a name that differ, or a model that is drawn to a scale.
        """
        scale, flag, name = (self.header[k].strip() if k < len(self.header) else "" for k in (_SCALE, _FLAG, _NAME))
        if scale and not (_REAL.fullmatch(scale) and _float(scale) == 1):
            raise ParseError(f"the model space scale is {shown(scale)}; needs 1.", self.name, self.line)
        # A file without a flag is in inches.
        number = int(flag or 1) if _INTEGER.fullmatch(flag or "1") else 0
        name = name.partition("H")[2].strip().upper()
        name = "IN" if name == "INCH" else name
        # The flag of a unit that only has a name.
        unit = name if number == 3 else next((unit for unit, (own, _) in UNITS.items() if own == number), "")
        if unit not in UNITS or name in UNITS and name != unit:
            message = (
                f"the unit has the flag {shown(flag)} and the name {shown(name)}; needs one of {', '.join(UNITS)}."
            )
            raise ParseError(message, self.name, self.line)
        return unit

    def record(self, entry: IgesEntry) -> "IgesRecord":
        """The parameters of an entry.

        Raises:
            ParseError: lines that are not there or belong to another entry, or a record without an end.
        """
        start = entry.first - 1
        if entry.first < 1 or entry.count < 1 or start + entry.count > len(self.parameters):
            message = f"points to {entry.count} parameter lines from {entry.first}; there are {len(self.parameters)}."
            raise ParseError(f"D{entry.sequence} {message}", self.name, entry.line)
        lines = self.parameters[start : start + entry.count]
        for text, number in lines:
            if _integer(self.name, number, text, _PARAMETERS) != entry.sequence:
                found = shown(text[_PARAMETERS:].strip())
                raise ParseError(f"a parameter line of D{entry.sequence} names {found}.", self.name, number)
        text = "".join(line.text[:_PARAMETERS] for line in lines)
        words = split_record(self.name, lines[0].number, text, self.delimiters)
        record = IgesRecord(self.name, lines[0].number, entry, words)
        if record.integer(0) != entry.type:
            raise record.error(f"begins with {shown(words[0].strip())} in the parameter section.")
        return record


class IgesRecord(NamedTuple):
    """The parameters of an entry as words, the type of the entity first."""

    file: object
    line: int
    entry: IgesEntry
    words: Sequence[str]

    def error(self, message: str) -> ParseError:
        """An error with the message, the entity and its line."""
        return ParseError(f"entity {self.entry.type} (D{self.entry.sequence}) {message}", self.file, self.line)

    def needs(self, count: int) -> None:
        """Raise ParseError if fewer than `count` parameters follow the type."""
        if len(self.words) - 1 < count:
            raise self.error(f"has {len(self.words) - 1} parameters; needs {count}.")

    def integer(self, index: int) -> int:
        """The integer parameter at this index, from 1; an omitted parameter is 0 (section 2.2.2.8)."""
        word = self.words[index].strip()
        if word and not _INTEGER.fullmatch(word):
            raise self.error(f"has parameter {index} {shown(word)}; needs an integer.")
        return int(word or 0)

    def flag(self, index: int) -> bool:
        """The parameter at this index as a flag."""
        value = self.integer(index)
        if value not in (0, 1):
            raise self.error(f"has parameter {index} {value}; needs 0 or 1.")
        return bool(value)

    def reals(self, index: int, count: int) -> list[float]:
        """`count` parameters from this index on, as floats."""
        return [self._real(index + k, word.strip()) for k, word in enumerate(self.words[index : index + count])]

    def _real(self, index: int, word: str) -> float:
        if not word:
            return 0.0
        if not _REAL.fullmatch(word):
            raise self.error(f"has parameter {index} {shown(word)}; needs a number.")
        return _float(word)


def _float(word: str) -> float:
    # D marks double precision.
    return float(word.replace("D", "E").replace("d", "e"))


def read_iges(file: object, content: bytes) -> IgesFile:
    """The sections of a file, checked against each other.

    Raises:
        ParseError: anything that is not as the format says, with its line.
    """
    sections = _sections(file, content)
    start = sections["G"][0].number
    text = "".join(line.text for line in sections["G"])
    delimiters = _delimiters(file, start, text)
    words = split_record(file, start, text, delimiters)
    directory = sections["D"]
    if len(directory) % 2:
        raise ParseError("a directory entry has two lines; the last one has one.", file, directory[-1].number)
    pairs = zip(directory[::2], directory[1::2], strict=True)
    entries = [_entry(file, 2 * k + 1, *pair) for k, pair in enumerate(pairs)]
    return IgesFile(file, start, words, {entry.sequence: entry for entry in entries}, sections["P"], delimiters)


def _sections(file: object, content: bytes) -> dict[str, list[IgesLine]]:
    """The lines of each section; every section is there, in order, with its lines numbered from 1."""
    sections: dict[str, list[IgesLine]] = {letter: [] for letter in _SECTIONS}
    lines = content.splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    at = 0
    for number, line in enumerate(lines, 1):
        text = line.decode("latin-1")
        if len(text) != _WIDTH:
            raise ParseError(f"a line of IGES has {_WIDTH} columns; this one has {len(text)}.", file, number)
        letter = text[72]
        if letter in "BC" and number == 1:
            raise ParseError("the binary and the compressed format of IGES are not read; needs the fixed one.", file, 1)
        if letter not in _SECTIONS or _SECTIONS.index(letter) < at:
            needed = ", ".join(_SECTIONS[at:])
            raise ParseError(f"column 73 is {letter!r}; needs the letter of a section, {needed}.", file, number)
        at = _SECTIONS.index(letter)
        sections[letter].append(IgesLine(text[:72], number))
        if text[73:].strip().lstrip("0") != str(len(sections[letter])):
            raise ParseError(f"columns 74 to 80 are {text[73:]!r}; needs {len(sections[letter])}.", file, number)
    _check_sections(file, len(lines), sections)
    return sections


def _check_sections(file: object, last: int, sections: dict[str, list[IgesLine]]) -> None:
    for letter in _SECTIONS:
        if not sections[letter]:
            raise ParseError(f"has no {_NAMES[letter]} section ({letter}).", file, last or None)
    if len(sections["T"]) > 1:
        raise ParseError("the terminate section has one line; there are more.", file, last)
    text = sections["T"][0].text
    for k, letter in enumerate("SGDP"):
        field, count = text[_FIELD * k : _FIELD * (k + 1)], len(sections[letter])
        if field[0] != letter or field[1:].strip().lstrip("0") != str(count):
            raise ParseError(f"the terminate section has {field!r}; there are {count} lines of {letter}.", file, last)


def _delimiters(file: object, line: int, text: str) -> tuple[str, str]:
    """The delimiters of parameters and of records: the first two parameters of the global section (2.2.4.3)."""
    parameter = text[2] if text.startswith("1H") else ","
    rest = text[3:] if text.startswith("1H") else text
    if not rest.startswith(parameter):
        raise ParseError(f"the global section begins with {text[:12]!r}; needs 1H,, or a comma.", file, line)
    rest = rest[1:]
    record = rest[2] if rest.startswith("1H") else ";"
    behind = rest[3:] if rest.startswith("1H") else rest
    bad = _NO_DELIMITERS & {parameter, record}
    if bad or parameter == record or behind[:1] not in (parameter, record):
        raise ParseError(f"the delimiters {text[:12]!r} of the global section cannot be used.", file, line)
    return parameter, record


def split_record(file: object, line: int, text: str, delimiters: tuple[str, str]) -> list[str]:
    """The parameters of a record up to its end, strings with their lengths in front: 5HHELLO.

    Raises:
        ParseError: there is no end, or a string is longer than the remaining text.
    """
    parameter, record = delimiters
    if "H" not in text and record in text:
        return text[: text.index(record)].split(parameter)
    ends = re.escape(parameter) + re.escape(record)
    # The patterns do not backtrack, so that blanks without an end are read once.
    plain, string = re.compile(rf" *+(?:([0-9]{{1,6}})H|[^{ends}]*+([{ends}]))"), re.compile(rf" *+([{ends}])")
    words, at, end = [], 0, ""
    while end != record:
        found = plain.match(text, at)
        stop = -1 if found is None else found.end()
        if found is not None and found.group(1):
            stop += int(found.group(1))
            # A string that runs past the text has no delimiter behind it.
            found = string.match(text, stop)
        if found is None:
            raise ParseError(f"a record has no end at {shown(text[at:].strip())}; needs {record!r}.", file, line)
        end = found.group(found.lastindex or 0)
        words.append(text[at : found.end() - 1])
        at = found.end()
    return words


def _entry(file: object, sequence: int, first: IgesLine, second: IgesLine) -> IgesEntry:
    def field(line: IgesLine, k: int) -> int:
        return _integer(file, line.number, line.text, _FIELD * (k - 1), _FIELD * k)

    if field(first, 1) != field(second, 1):
        raise ParseError(f"D{sequence} is of type {field(first, 1)}; its second line differs.", file, second.number)
    status = first.text[64:72].replace(" ", "0")
    if not re.fullmatch("[0-9]{8}", status, re.ASCII):
        raise ParseError(f"the status of D{sequence} is {first.text[64:72]!r}; needs 8 digits.", file, first.number)
    blank, subordinate, use = int(status[:2]), int(status[2:4]), int(status[4:6])
    return IgesEntry(
        first.number, sequence, field(first, 1), field(second, 5), field(first, 7),
        blank == 1, subordinate in (1, 3), use, field(first, 2), field(second, 4),
    )  # fmt: skip


def _integer(file: object, line: int, text: str, start: int, stop: int | None = None) -> int:
    """The integer in these columns, counted from 0; blanks are 0."""
    word = text[start:stop].strip()
    if word and not _INTEGER.fullmatch(word):
        columns = f"columns {start + 1} to {stop or len(text)}"
        raise ParseError(f"{columns} are {shown(word)}; needs an integer.", file, line)
    return int(word or 0)
