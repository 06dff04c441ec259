"""Certificates of version 1, which were of curves alone: the same claims in the form of today."""

from collections.abc import Mapping
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any

from jhd.distance.certificate.verification.structure import KINDS, CertificateError, check_index, check_keys, check_list

_KEYS = ("format", "version", "claim", "a", "b", "cells", "witness")


def current(content: Any) -> Any:
    """The certificate in the form of today; what is of no first version, or not looked at here, is left as it is.

    Raises:
        CertificateError: a key is missing, unknown, or of another kind, so that there is nothing to translate.
    """
    if not isinstance(content, Mapping) or content.get("version") != 1 or isinstance(content["version"], bool):
        return content
    check_keys("the certificate", content, _KEYS)
    shapes = {}
    for name in ("a", "b"):
        check_keys(name, content[name], ("control_points", "weights"))
        check_list(f"{name}.control_points", content[name]["control_points"])
        check_list(f"{name}.control_points[0]", content[name]["control_points"][0])
        shapes[name] = {"kind": "curve", **content[name]}
    cells = content["cells"]
    if cells is not None:
        check_keys("cells", cells, [name for name in KINDS["two_sided"] if name in cells])
        cells = {name: _cells(name, rows, shapes) for name, rows in cells.items()}
    return {
        **content,
        "version": 2,
        **shapes,
        "orders": None,
        "cells": cells,
        "witness": _witness(content["witness"], shapes),
    }


def _is_points(shape: Mapping[str, Any]) -> bool:
    return len(shape["control_points"][0]) == 1


def _cells(direction: str, rows: Any, shapes: Mapping[str, Any]) -> list[dict[str, Any]]:
    source, target = shapes[direction[0]], shapes[direction[-1]]
    found = []
    for k, row in enumerate(check_list(f"cells.{direction}", rows)):
        place = f"cells.{direction}[{k}]"
        check_keys(place, row, ("segment", "t", "foot", "sigma", "sigma_weights", "bound"))
        check_index(f"{place}.segment", row["segment"], len(source["control_points"]))
        ends = check_list(f"{place}.t", row["t"], 2, 2)
        if not all(isinstance(t, int | float) for t in ends):
            raise CertificateError(f"{place}.t is {repr(ends)}; needs numbers.")
        sigma = check_list(f"{place}.sigma", row["sigma"])
        foot = {"piece": row["foot"], "map": [[s] for s in sigma], "weights": row["sigma_weights"]}
        if _is_points(target):
            foot = {"piece": row["foot"], "map": [[]], "weights": None}
        cell = None if _is_points(source) else ends
        found.append(
            {"piece": row["segment"], "cell": cell, "feet": [foot], "multipliers": None, "bound": row["bound"]}
        )
    if _is_points(source):
        # A point takes one cell; of more the last one counts.
        found = list({cell["piece"]: cell for cell in found}.values())
    return sorted(found, key=lambda cell: (cell["piece"], cell["cell"] or [0]))


def _witness(witness: Any, shapes: Mapping[str, Any]) -> dict[str, Any] | None:
    if witness is None:
        return None
    check_keys("witness", witness, ("direction", "segment", "t", "cuts"))
    direction = witness["direction"]
    if not isinstance(direction, str) or direction not in KINDS["two_sided"]:
        raise CertificateError(f"witness.direction is {repr(direction)}; needs a_to_b or b_to_a.")
    source, target = shapes[direction[0]], shapes[direction[-1]]
    at = [] if _is_points(source) else [witness["t"]]
    cuts = None if _is_points(target) else witness["cuts"]
    return {"direction": direction, "piece": witness["segment"], "at": at, "cuts": cuts}
