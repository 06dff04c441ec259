"""Reading of files, and the errors that it raises."""

from collections.abc import Iterator
from io import BytesIO, TextIOWrapper
from pathlib import Path


class ParseError(ValueError):
    """Text or a file cannot be read; the message starts with file, line and column, as in compilers.

    >>> import jhd
    >>> print(jhd.io.ParseError("needs numbers; found 'x'.", "cloud.xyz", 3))
    cloud.xyz:3: needs numbers; found 'x'.

    Args:
        message: the value found and the value needed.
        file: the file; None for text that does not come from a file.
        line: line number from 1; None if unknown.
        column: column in this line, from 1; None if unknown.
    """

    def __init__(self, message: str, file: object = None, line: int | None = None, column: int | None = None):
        self.file = None if file is None else str(file)
        self.line = line
        self.column = column
        self.reason = message
        if self.file is None:
            named = [f"{name} {number}" for name, number in (("line", line), ("column", column)) if number is not None]
            place = ", ".join(named)
        else:
            place = ":".join(str(part) for part in (self.file, line, column) if part is not None)
        super().__init__(f"{place}: {message}" if place else message)


def shown(value: object, most: int = 60) -> str:
    """A value for messages: in quotes if it is text, on one line, cut to `most` characters.

    >>> shown("x" * 100, 10)
    "'xxxxxx..."
    """
    # A long text is cut before its copy in quotes is made.
    text = repr(value[: most + 1] if isinstance(value, str | bytes) else value)
    return text if len(text) <= most else text[: most - 3] + "..."


def place_in(text: str, index: int) -> tuple[int, int]:
    """Line and column, both from 1, of the character `index` of the text."""
    before = text[:index]
    return before.count("\n") + 1, index - before.rfind("\n")


def read_bytes(file: str | Path) -> bytes:
    """The bytes of a file.

    Raises:
        FileNotFoundError: the file does not exist; its message is one line.
    """
    try:
        return Path(file).read_bytes()
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: no such file.") from None


def read_text(file: str | Path) -> str:
    """The text of a UTF-8 file, without its byte order mark.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: the bytes are not UTF-8 text.
    """
    try:
        return read_bytes(file).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ParseError(f"byte {error.start} is not UTF-8 text.", file) from error


def numbered_lines(content: bytes, first: int = 1) -> Iterator[tuple[int, str]]:
    """The lines of a text in any superset of ASCII, as characters of one byte each, and their numbers.

    Lines end as in text editors. Other characters at which Python ends lines, such as byte 133, are parts of letters in
    UTF-8.

    Args:
        content: the text.
        first: the number of its first line.
    """
    for number, line in enumerate(TextIOWrapper(BytesIO(content), "latin-1"), first):
        yield number, line.removesuffix("\n")
