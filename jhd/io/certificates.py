"""Certificates in files: lines of strict JSON, read without any doubt about what they say."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jhd.distance.certificate.certificate import Certificate
from jhd.distance.certificate.sides import plain_shape
from jhd.distance.certificate.verification import CertificateError, Proven, digest, opened, verify
from jhd.io.errors import ParseError


def load_certificate(file: str | Path) -> Certificate:
    """The certificate in a file, compressed or not; `verify` checks what it claims.

    Args:
        file: what `Certificate.save` wrote.

    Raises:
        FileNotFoundError: there is no such file.
        ParseError: text that is no JSON, with line and column; NaN and Infinity, which Python would read, are none.
        CertificateError: JSON of another structure, or with a key that occurs twice.
    """
    with _read(file) as content:
        if isinstance(content, dict) and isinstance(content.get("cells"), dict):
            content["cells"] = {name: list(iter(cells)) for name, cells in content["cells"].items()}
        return Certificate(content)


def verify_file(
    file: str | Path,
    seconds: float | None = None,
    shapes: Sequence[Any] = (),
    progress: Callable[[str], object] | None = None,
) -> Proven:
    """What the certificate in a file proves, checked cell by cell as it is read.

    Args:
        file: as for `load_certificate`.
        seconds: after how long to give up.
        shapes: a and b, if the claim has to be about them.
        progress: called with the place in the certificate that is checked next.

    Raises:
        FileNotFoundError: as for `load_certificate`.
        ParseError: likewise.
        CertificateError: likewise, or the claim is not proven, or is about other shapes.
    """
    with _read(file) as content:
        proven = verify(content, seconds, progress)
        for name, shape in zip("ab", shapes, strict=False):
            if digest(content[name]) != plain_shape(shape)["sha256"]:
                raise CertificateError(f"the claim is proven, but {name.upper()} is another shape than the one given.")
        return proven


@contextmanager
def _read(file: str | Path) -> Iterator[Any]:
    """The content of the file, with the errors of all readers."""
    try:
        with opened(file) as content:
            yield content
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: no such file.") from None
    except json.JSONDecodeError as error:
        raise ParseError(f"JSON: {error.msg}.", file, error.lineno, error.colno) from error
    except RecursionError as error:
        raise ParseError("JSON: nested too deeply.", file) from error
    except CertificateError:
        raise
    except UnicodeDecodeError as error:
        raise ParseError("is not UTF-8 text.", file) from error
    except ValueError as error:  # of whole numbers with thousands of digits, and of broken compression
        raise ParseError(f"JSON: {error}", file) from error
