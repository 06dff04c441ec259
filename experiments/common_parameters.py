"""Options of an experiment: a seed, files, two shapes, and other values of its constants in capitals.

Figures have these options too. So this module, like common_origin, imports no other shared module.
"""

import argparse
import ast
from typing import Any

import numpy as np

_SINGLE = (bool, int, float, str, np.ndarray, type(None))
# Options that change the numbers, except --smoke.
_ASKED = ("seed", "set", "meshes", "a", "b")


def add_options(parser: argparse.ArgumentParser, meshes: bool, pair: bool) -> None:
    """Add the options; those for files and for two shapes only if the experiment accepts them."""
    parser.add_argument("--seed", type=int, default=0, help="seed of the random numbers (default: 0)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="another value of a constant in capitals"
    )
    parser.set_defaults(meshes=[], a=None, b=None)
    if meshes:
        parser.add_argument("--meshes", nargs="+", metavar="FILE", help="files to take, also .npz of V and F")
    if pair:
        parser.add_argument("--a", metavar="SHAPE", help="a file, font:NAME:LETTER or SVG path data; with --b")
        parser.add_argument("--b", metavar="SHAPE", help="the other shape")


def asked(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options that the user passed."""
    return {name: getattr(options, name) for name in _ASKED if getattr(options, name)}


def as_flags(asked: dict[str, Any]) -> list[str]:
    """Return these options as arguments of a script."""
    flags = []
    for name, value in asked.items():
        # Each --set has its own flag, and all meshes have one.
        groups = [[x] for x in value] if name == "set" else [value] if name == "meshes" else [[str(value)]]
        flags += [word for group in groups for word in (f"--{name}", *group)]
    return flags


def parameters(names: dict[str, Any]) -> dict[str, Any]:
    """Return the constants of a script whose values can be written as literals."""
    return {name: value for name, value in names.items() if name.isupper() and _is_literal(value)}


def _is_literal(value: Any) -> bool:
    """Return whether a value can be written as a literal; curves and functions cannot."""
    if isinstance(value, dict):
        return _is_literal((*value.keys(), *value.values()))
    return all(map(_is_literal, value)) if isinstance(value, tuple | list) else isinstance(value, _SINGLE)


def change(names: dict[str, Any], settings: list[str]) -> dict[str, Any]:
    """Set constants of a script to other values, and return these.

    Args:
            names: the names of the script; changed in place.
            settings: texts NAME=VALUE; the value is a literal of the constant's type.

    Raises:
            ValueError: if the constant does not exist or has another type.
    """
    known, found = parameters(names), {}
    for setting in settings:
        name, sign, text = setting.partition("=")
        if not sign or name not in known:
            raise ValueError(f"--set {setting}: needs NAME=VALUE; there are {', '.join(known)}.")
        found[name] = _value(name, text, known[name])
    names.update(found)
    return found


def _value(name: str, text: str, known: Any) -> Any:
    """Parse the text of a value of the constant's type."""
    kind = type(known)
    try:
        value = ast.literal_eval(text)
    except (SyntaxError, ValueError):
        value = text  # a string without quotes
    # If the constant is a float, an integer will do; a list will do for an array.
    if kind is float and type(value) is int:
        value = float(value)
    if kind is np.ndarray and isinstance(value, list | tuple):
        value = np.array(value, known.dtype)
    if type(value) is not kind:
        raise ValueError(f"--set {name}: needs a value of type {kind.__name__}, as {known!r}; got {text}.")
    return value
