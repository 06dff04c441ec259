"""How often the code asks for the kind of a shape: only bodies depend on it, and other code calls their methods."""

import ast
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parent.parent / "jhd"

# Shapes, shapes in common coordinates, and the numbers that a point of a shape depends on.
KINDS = {
    *(
        "AbstractCurve",
        "BezierCurve",
        "BezierSegments",
        "BSplineCurve",
        "AbstractPatch",
        "BezierPatch",
        "BezierPatches",
    ),
    *("BSplineSurface", "ImplicitSurface", "TriangleMesh", "Shape", "Net", "Side", "Triangles"),
    *("AbstractRows", "NetRows", "CornerRows", "Polynomial"),
}
# Most tests in jhd/_distance without certificates, which have sides of their own. It may only become smaller.
MOST = 50


def asks(node):
    """Whether a node is a call of isinstance for one of the kinds."""
    is_test = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance"
    return is_test and bool(KINDS & {name.id for name in ast.walk(node.args[1]) if isinstance(name, ast.Name)})


def lines_that_ask(path):
    nodes: list[Any] = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    return [f"{path.relative_to(PACKAGE)}:{node.lineno}" for node in nodes if asks(node)]


def test_few_functions_ask_for_the_kind_of_a_shape():
    files = [path for path in (PACKAGE / "_distance").rglob("*.py") if "certificate" not in path.parts]
    found = [line for path in sorted(files) for line in lines_that_ask(path)]
    assert len(found) <= MOST, "\n".join(found)


def test_bodies_themselves_do_not_ask():
    for name in ("body", "bodies"):
        assert not lines_that_ask(PACKAGE / "_distance" / "search" / f"{name}.py")
