"""The checker as a command: `python FOLDER [--shapes] [--max-seconds S] FILE...`, with nothing but Python.

With --shapes it also prints the hashes of the shapes, which can be compared with the hashes of files at hand.

The modules import each other by their location in the package. If this folder stands alone, that location is created
for it as an empty package with this folder only, so that nothing of the rest of the package is loaded.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

_PLACE = "jhd._distance.certificate.verification"


def main(arguments: Sequence[str]) -> int:
    """Check certificates in files and print what each proves; return the exit status."""
    from jhd._distance.certificate.verification import (
        CertificateError,
        UncheckedCertificateError,
        digest,
        opened,
        sentence,
        verify,
    )

    parser = ArgumentParser("python verification", description="Check certificates and print what each proves.")
    parser.add_argument("--shapes", action="store_true", help="hashes of the shapes in addition")
    parser.add_argument("--max-seconds", type=float, metavar="S", help="time limit for each file (default: none)")
    parser.add_argument("files", nargs="+", metavar="FILE", help="certificate")
    options, status = parser.parse_intermixed_args(arguments), 0
    if options.max_seconds is not None and not options.max_seconds > 0:
        parser.error(f"--max-seconds is {options.max_seconds}; needs a positive number.")
    for name in options.files:
        try:
            with opened(name) as content:
                proven = verify(content, options.max_seconds)
                hashes = [digest(content[shape]) for shape in "ab"]
        except CertificateError as error:
            print(f"refused: {name}: {error}", file=sys.stderr)
            # As of `jhd verify`: refused, or not checked in the time.
            status = status or (1 if isinstance(error, UncheckedCertificateError) else 4)
        except (OSError, EOFError, ValueError, RecursionError, MemoryError) as error:
            print(f"not read: {name}: {error}", file=sys.stderr)
            status = 2
        else:
            print(f"proven: {name}: {sentence(proven)}")
            if options.shapes:
                print(*(f"  {shape} has SHA-256 {value}" for shape, value in zip("AB", hashes, strict=True)), sep="\n")
    return status


def _make_place() -> None:
    """Load this folder under its name in the package, whose other folders stay empty."""
    *above, _ = _PLACE.split(".")
    for k in range(len(above)):
        empty = ModuleType(".".join(above[: k + 1]))
        empty.__path__ = []
        sys.modules[empty.__name__] = empty
    folder = Path(__file__).resolve().parent
    spec = spec_from_file_location(_PLACE, folder / "__init__.py", submodule_search_locations=[str(folder)])
    if spec is None or spec.loader is None:
        raise ImportError(f"{folder} is no package.")
    sys.modules[_PLACE] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[_PLACE])


if __name__ == "__main__":
    if not __package__:
        _make_place()
    sys.exit(main(sys.argv[1:]))
