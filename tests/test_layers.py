"""The rules of the package's structure: who may import whom, where names may be re-exported, what no module may do."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parent.parent / "jhd"


# Folders, and single files beside them, from the lowest to the highest. A module may import from what stands in a line
# above its own, or in its own line before it; those of one line that are parted by a bar know nothing of each other.
# Inside a folder the order is free, as long as there is no cycle.
ORDER = """
    _runtime progress _results
    _arithmetic arithmetic
    _shapes
    _triangles
    _fields
    _distance.normalization _distance.nearest _distance.cells _distance.witness _distance.search
        _distance.published.events _distance.published _distance.certificate _distance _distance.statistics published
        typing
    _fitting | _plot plot | _io io
    _cli.lengths _cli.report _cli.console _cli __main__ _cli.helping
"""
# The checker of certificates runs by itself, and is its own command line.
CHECKER = "_distance.certificate.verification.__main__"
COMMAND_LINE = (
    *(CHECKER, "_runtime.starting", "_cli.console", "__main__"),
    *("_cli.lengths", "_cli.output", "_cli.comparisons", "_cli.collected", "_cli.commands"),
)
# Their import takes a tenth of a second and more, so they may be imported where they are used.
HEAVY = {"matplotlib", "mpl_toolkits", "fontTools", "scipy", "shapely", "trimesh", "pyvista", "skimage"} | {
    "svgelements",
    "plotly",
    "sympy",
}


def places():
    """The line, the part of the line and the position there of each folder and single file."""
    joined = ORDER.replace("\n        ", " ").strip().splitlines()
    return {
        name: (line, part, position)
        for line, row in enumerate(joined)
        for part, names in enumerate(row.split("|"))
        for position, name in enumerate(names.split())
    }


PLACES = places()


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path) -> list[Any]:
    return list(ast.walk(tree(path)))


def name_of(path):
    """The module's name within the package: `_shapes.curve`, `_shapes` for its __init__ file, "" for the package's."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = sorted(PACKAGE.rglob("*.py"))
MODULES = [path for path in FILES if path.name != "__init__.py"]
INITS = [path for path in FILES if path.name == "__init__.py"]
KNOWN = {name_of(path) for path in FILES}


def by_name(path):
    return name_of(path) or "jhd"


def imported(node):
    """The modules that an import statement names, with their full dotted names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, f"line {node.lineno}: relative import"
        names = [f"{node.module}.{alias.name}" for alias in node.names]
        return [name if name.removeprefix("jhd.") in KNOWN else node.module or "" for name in names]
    return []


def of_package(path, nodes):
    """The package's own modules among the imports, without the leading `jhd.`; `jhd` itself is the empty name."""
    names = [(node.lineno, name) for node in nodes for name in imported(node)]
    return [(line, name[4:]) for line, name in names if name == "jhd" or name.startswith("jhd.")]


@cache
def function_nodes(path) -> list[Any]:
    """Every node inside a function."""
    functions = [n for n in nodes_of(path) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)]
    return [inner for function in functions for inner in ast.walk(function) if inner is not function]


def owner_of(name):
    """The folder or single file in the order that holds a module; of a folder inside another one the inner."""
    parts = name.split(".")
    found = [".".join(parts[:k]) for k in range(len(parts), 0, -1) if ".".join(parts[:k]) in PLACES]
    assert found, f"{name} has no place in the order of folders"
    return found[0]


def is_below(other, name):
    """Whether a module of the folder `other` may be imported by one of the folder `name`."""
    (line, part, position), (mine, beside, own) = PLACES[other], PLACES[name]
    return line < mine or (line == mine and part == beside and position <= own)


def test_a_module_imports_from_lower_folders_or_its_own_only():
    top = max(place[0] for place in PLACES.values())
    wrong = []
    for path in MODULES:
        own = owner_of(name_of(path))
        for line, other in of_package(path, nodes_of(path)):
            # The command line talks to the package as a user does.
            allowed = PLACES[own][0] == top if other == "" else is_below(owner_of(other), own)
            wrong += [] if allowed else [f"{by_name(path)}:{line} imports {other or 'the package itself'}"]
    assert not wrong


def test_an_upward_import_between_folders_is_found():
    assert not is_below("_distance.search", "_distance.cells") and not is_below("_plot", "_io")
    assert is_below("_distance.cells", "_distance.search") and is_below("_distance.search", "_distance.search")
    assert owner_of("_distance.search.curves") == "_distance.search" and owner_of("_distance.hausdorff") == "_distance"


def test_no_modules_import_each_other_in_a_circle():
    imports = {name_of(path): {other for _, other in of_package(path, nodes_of(path))} for path in MODULES}
    done: set[str] = set()

    def visit(name, above):
        assert name not in above, " -> ".join([*above[above.index(name) :], name])
        if name not in done:
            for other in imports.get(name, ()):
                visit(other, [*above, name])
            done.add(name)

    for name in imports:
        visit(name, [])


def test_only_heavy_packages_are_imported_inside_functions():
    # The command line loads what a command needs, so that its help comes at once.
    found = [
        f"{by_name(path)}:{node.lineno} imports {other}"
        for path in MODULES
        if name_of(path) not in COMMAND_LINE
        for node in function_nodes(path)
        for other in imported(node)
        if other.split(".")[0] not in HEAVY
    ]
    assert not found


def test_heavy_packages_that_are_optional_are_never_imported_with_a_module():
    optional = {"trimesh", "skimage", "svgelements", "sympy", "shapely"}
    for path in MODULES:
        # What only type checkers read is not imported either.
        checked = [n for n in nodes_of(path) if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
        inside = {id(node) for node in [*function_nodes(path), *(x for n in checked for x in ast.walk(n))]}
        outer = [node for node in nodes_of(path) if id(node) not in inside]
        found = {name.split(".")[0] for node in outer for name in imported(node)} & optional
        assert not found, f"{by_name(path)} imports {found}"


def forbidden(node):
    """What the library leaves to its callers: printing, warnings, and assertions, which -O removes."""
    if isinstance(node, ast.Assert):
        return "assert"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
        return "print"
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return ast.unparse(node) if ast.unparse(node) in ("warnings.warn", "os.environ") else None
    if isinstance(node, ast.Attribute) and ast.unparse(node) == "jax.config.update":
        return "jax.config.update"
    return None


def test_nothing_is_printed_warned_of_asserted_or_set_globally_below_the_command_line():
    below = [path for path in MODULES if name_of(path) not in COMMAND_LINE]
    nodes: list[tuple[Path, Any]] = [(path, node) for path in below for node in nodes_of(path)]
    found = [f"{by_name(path)}:{node.lineno} {what}" for path, node in nodes if (what := forbidden(node))]
    assert not found


def test_the_init_file_of_a_folder_holds_names_and_a_docstring():
    for path in INITS:
        if path.parent == PACKAGE or path.read_text(encoding="utf-8") == "":
            continue
        assert ast.get_docstring(tree(path)), f"{by_name(path)} has no docstring"
        for node in tree(path).body[1:]:
            exported = isinstance(node, ast.ImportFrom) or (
                isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
            )
            assert exported, f"{by_name(path)}:{node.lineno}: {ast.unparse(node)[:60]}"


def test_the_init_file_of_the_package_holds_names_the_version_the_switch_to_float64_and_what_is_imported_later():
    docstring, *body = tree(PACKAGE / "__init__.py").body
    assert isinstance(docstring, ast.Expr)
    others = [node for node in body if not isinstance(node, ast.Import | ast.ImportFrom)]
    switches, known = (
        [node for node in others if isinstance(node, ast.If)],
        "if _TYPE_CHECKING:\n    from jhd import io as io",
    )
    later = [node.name for node in others if isinstance(node, ast.FunctionDef)]
    names = [ast.unparse(node.targets[0]) for node in others if isinstance(node, ast.Assign)]
    assert len(switches) == 2 and "jax_enable_x64" in ast.unparse(switches[0]) and ast.unparse(switches[1]) == known
    assert later == ["__getattr__", "__dir__"]
    assert set(names) <= {"__version__", "__all__"} and len(names) + 4 == len(others)


def test_every_function_and_class_that_has_no_leading_underscore_has_a_docstring():
    missing = []
    for path in MODULES:
        for node in tree(path).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                missing += [] if ast.get_docstring(node) else [f"{by_name(path)}.{node.name}"]
    assert not missing


def test_a_class_name_stands_once_in_the_package():
    """Underscores in front set names of one word no farther apart."""
    found = defaultdict(list)
    for path in MODULES:
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                found[node.name.lstrip("_")].append(name_of(path))
    assert not {name: places for name, places in found.items() if len(places) > 1}
