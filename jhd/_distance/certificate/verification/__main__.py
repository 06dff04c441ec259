"""The checker as a command: `python FOLDER [--shapes] [--max-seconds S] FILE...`, with nothing but Python.

With --shapes it also prints the hashes of the shapes, which can be compared with the hashes of files at hand.

The modules import each other by their location in the package. If this folder stands alone, that location is created
for it as an empty package with this folder only, so that nothing of the rest of the package is loaded.
"""

import sys
from collections.abc import Sequence
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

_PLACE = "jhd._distance.certificate.verification"
_USAGE = "usage: python verification [--shapes] [--max-seconds S] FILE..."


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

    files, seconds = [name for name in arguments if name != "--shapes"], None
    if files and files[0] == "--max-seconds":
        seconds, files = _number(files[1:2]), files[2:]
    if not files or (seconds is not None and not seconds > 0):
        print(_USAGE, file=sys.stderr)
        return 2
    status = 0
    for name in files:
        try:
            with opened(name) as content:
                proven = verify(content, seconds)
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
            if "--shapes" in arguments:
                print(*(f"  {shape} has SHA-256 {value}" for shape, value in zip("AB", hashes, strict=True)), sep="\n")
    return status


def _number(texts: Sequence[str]) -> float:
    """Return the number that was given; 0, which is refused, if there is none."""
    try:
        return float(texts[0])
    except (IndexError, ValueError):
        return 0.0


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
