"""Digests of the code and files that results and pictures depend on: a script with its local imports, and files.

An experiment stores them with its numbers, so that a figure can report if its numbers are older than the code. This
module imports only Python's standard library, so that figures, which have a `common` of their own, can run it by path.
"""

import ast
import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(r"^(?:import|from) (common\w*)", re.MULTILINE)
_MODEL = re.compile(r"^model name\s*:\s*(.*)$", re.MULTILINE)
# Enough digits to tell versions of one script apart.
_DIGITS = 16


def code_of(script: Path) -> dict[str, str]:
    """Return digests of a script with its shared modules, without docstrings, and of the package."""
    package = ROOT / "jhd"
    scripts = [(file, _without_docstrings(file).encode()) for file in _with_imports(script)]
    return {"script": _sum(scripts), "package": digest(sorted(package.rglob("*.py")))}


def digest(files: Iterable[Path]) -> str:
    """Return a digest of the names and contents of files, in order."""
    return _sum((file, file.read_bytes()) for file in files)


def _without_docstrings(file: Path) -> str:
    """Return the code of a script without docstrings, which change no numbers."""
    text = file.read_text(encoding="utf-8")
    lines = text.splitlines()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            for k in range(node.body[0].lineno - 1, node.body[0].end_lineno or 0):
                lines[k] = ""
    return "\n".join(line for line in lines if line)


def _sum(contents: Iterable[tuple[Path, bytes]]) -> str:
    found = hashlib.sha256()
    for file, content in contents:
        found.update(f"{file.name} {len(content)} ".encode())
        found.update(content)
    return found.hexdigest()[:_DIGITS]


def outdated(context: dict, script: Path) -> str:
    """Say which code has changed since results with this context were written; empty if nothing has changed."""
    then, now = context.get("code"), code_of(script)
    if then is None:
        return "their code was not recorded"
    changed = [name for name in now if then.get(name) != now[name]]
    return f"the {' and the '.join(changed)} changed since" if changed else ""


def machine() -> dict:
    """Return the processor, its load, and the commit of the code, as far as they are known."""
    return {"processor": _processor(), "load": _load(), "commit": _commit()}


def _with_imports(script: Path) -> list[Path]:
    """Return the script and the modules of its folder that it imports, directly or not, each once."""
    found = [script]
    for file in found:
        for name in _IMPORT.findall(file.read_text(encoding="utf-8")):
            other = script.parent / f"{name}.py"
            if other.exists() and other not in found:
                found.append(other)
    return [script, *sorted(found[1:])]


def _processor() -> str:
    file = Path("/proc/cpuinfo")
    model = _MODEL.search(file.read_text(encoding="utf-8")) if file.exists() else None
    return model.group(1) if model else platform.processor()


def _load() -> list[float] | None:
    return list(os.getloadavg()) if hasattr(os, "getloadavg") else None


def _commit() -> str | None:
    """Return the commit of this folder, with a plus if files differ from it; None outside of a clone."""
    try:
        asked = ["git", "-C", str(ROOT), "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty=+"]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
