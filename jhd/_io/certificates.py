"""Reading of certificate files: lines of strict JSON in which duplicate keys, NaN and infinity are errors."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jhd._distance.certificate.certificate import Certificate, verify
from jhd._distance.certificate.sides import plain_shape
from jhd._distance.certificate.verification import CertificateError, Proven, digest, opened
from jhd._io.errors import ParseError
from jhd.progress import Callback


def load_certificate(file: str | Path) -> Certificate:
    """Load a certificate from a file, compressed or not; `jhd.verify` checks its claim.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> a, b = jhd.point_set([[0, 0]]), jhd.point_set([[3, 4]])
    >>> with TemporaryDirectory() as folder:
    ...     jhd.certify(a, b, jhd.directed_hausdorff(a, b)).save(f"{folder}/certificate.json")
    ...     round(jhd.verify(jhd.io.load_certificate(f"{folder}/certificate.json")).upper, 9)
    5.0

    Args:
        file: name of a file written by `Certificate.save`.

    Returns:
        The certificate, not yet verified.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: a line that is not strict JSON (NaN and Infinity are refused), with line and column.
        CertificateError: JSON of another structure, or with a duplicate key.
    """
    with _read(file) as content:
        if isinstance(content, dict) and isinstance(content.get("cells"), dict):
            content["cells"] = {name: list(iter(cells)) for name, cells in content["cells"].items()}
        return Certificate(content)


def verify_file(
    file: str | Path,
    max_seconds: float | None = None,
    shapes: Sequence[Any] = (),
    progress: Callback | None = None,
) -> Proven:
    """Verify the certificate in a file and return its claim; cells are checked one by one as they are read.

    Args:
        file: name of a file written by `Certificate.save`.
        max_seconds: time limit in seconds; None means no limit.
        shapes: a and b, if the claim must be about these shapes; an empty sequence accepts any.
        progress: called with a Progress, whose stage names the part of the certificate that is checked next.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: text that is not strict JSON, with line and column.
        CertificateError: JSON of another structure, a claim that is not proven, or a claim about other shapes.
    """
    with _read(file) as content:
        proven = verify(content, max_seconds=max_seconds, progress=progress)
        given, stored = [plain_shape(shape)["sha256"] for shape in shapes], [digest(content[name]) for name in "ab"]
        for name, mine, known in zip("AB", given, stored, strict=False):
            if mine != known:
                turned = "; the claim is about the shapes in the other order" if given[::-1] == stored else ""
                raise CertificateError(f"the claim is proven, but {name} is another shape than the one given{turned}.")
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
