"""Certificates in files: strict JSON, read without any doubt about what it says."""

import json
from pathlib import Path

from jhd.distance.certificate.certificate import Certificate
from jhd.distance.certificate.verification import CertificateError, parsed
from jhd.io.errors import ParseError, read_text


def load_certificate(file: str | Path) -> Certificate:
    """The certificate in a JSON file; `verify` checks what it claims.

    Args:
        file: what `Certificate.save` wrote.

    Raises:
        FileNotFoundError: there is no such file.
        ParseError: text that is no JSON, with line and column; NaN and Infinity, which Python would read, are none.
        CertificateError: JSON of another structure, or with a key that occurs twice.
    """
    text = read_text(file)
    try:
        content = parsed(text)
    except json.JSONDecodeError as error:
        raise ParseError(f"JSON: {error.msg}.", file, error.lineno, error.colno) from error
    except RecursionError as error:
        raise ParseError("JSON: nested too deeply.", file) from error
    except CertificateError:
        raise
    except ValueError as error:  # of whole numbers with thousands of digits too
        raise ParseError(f"JSON: {error}", file) from error
    return Certificate(content)
