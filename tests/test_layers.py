"""The rules of the package's structure: who may import whom, where names may be re-exported, what no module may do."""

import ast
from functools import cache
from pathlib import Path
from typing import Any

import pytest

PACKAGE = Path(__file__).parent.parent / "jhd"


def modules(folder, names):
    """The modules of a folder, in order; names are parted by blanks."""
    return [f"{folder}.{name}" for name in names.split()]


# Each entry of a layer lists its modules in order: a module may import from lower layers and from earlier modules of
# its own entry. Entries of one layer know nothing of each other. The order holds also for modules not listed here,
# since each of those must be added.
ARITHMETIC = "rounding rationals interval affine bernstein trivariate exact_polynomials polynomial_systems"
SHAPES = """
    checks knots convert homogeneous joints curve bezier bspline deviation biarc_fit biarc
    polynomial_text implicit mesh tessellation patch bspline_surface
"""
FIELDS = """
    boxes octree distance_transform point_triangle triangle_pairs exact_triangles box_tree closest_point
    vertex_voxels winding pseudonormal adaptive_samples adaptive_build adaptive_evaluate adaptive_extract adaptive_error
    adaptive distance_map
"""
DISTANCES = """
    jets prepare method nearest events active derivative local_feet stationarity
    mesh_projection signed_distance projection refinement two_step
    event_forms event_kernels event_systems event_survivors host_pair event_candidates farthest algebraic
    arc_bounds trimming
    bounds surface_foot surface_events surface_derivative search
    surface_prepare surface_bounds surface_points surface_signs surface_nearest surface_candidates surface_search
    surface_solution branch_and_bound driver cube_intervals
    mesh_cells mesh_witness mesh_search pairs hausdorff critical
    mesh_pairs minimum_meshes
    minimum_balls minimum_jets minimum_cells minimum_search minimum_nets minimum_host minimum_implicit
    minimum_surfaces minimum_mixed voxel_pairs
    minimum verification host covering certificate
"""
FILES_OF = """
    errors contours outlines path_data svg_elements svg_shapes svg_document svg curves polygons ply meshes load results
    certificates
"""
LAYERS: list[list[list[str]]] = [
    [["arrays", "compiled", "solution"]],
    [modules("arithmetic", ARITHMETIC)],
    [modules("shapes", SHAPES)],
    [modules("fields", FIELDS)],
    [modules("distance", DISTANCES)],
    [
        [*modules("fitting", "expansion subproblem minimax bundle chain"), "fit"],
        modules("plot", "axes curves nets faces implicit meshes solutions"),
        modules("io", FILES_OF),
    ],
    [["report", "options", "commands", "__main__"]],
]
COMMAND_LINE = ("commands", "__main__")
# Their import takes a tenth of a second and more, so they may be imported where they are used.
HEAVY = {"matplotlib", "mpl_toolkits", "fontTools", "scipy", "shapely", "trimesh", "skimage", "svgelements", "sympy"}

PLACES = {
    module: (layer, entry, position)
    for layer, entries in enumerate(LAYERS)
    for entry, modules in enumerate(entries)
    for position, module in enumerate(modules)
}


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def name_of(path):
    """The module's name within the package: `shapes.curve`, or `shapes` for its __init__ file, "" for the package's."""
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


def function_nodes(path) -> list[Any]:
    """Every node inside a function."""
    functions = [n for n in ast.walk(tree(path)) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)]
    return [inner for function in functions for inner in ast.walk(function) if inner is not function]


def place_of(name):
    """Place of a module; of a folder's __init__, which re-exports, the place behind its last module."""
    if name in PLACES:
        return PLACES[name]
    inside = [place for module, place in PLACES.items() if module.startswith(f"{name}.")]
    layer, entry, _ = inside[0]
    return layer, entry, len(LAYERS[layer][entry])


@pytest.mark.parametrize("path", MODULES, ids=by_name)
def test_a_module_imports_from_lower_layers_or_earlier_files_only(path):
    name = name_of(path)
    assert name in PLACES, f"{name} has no place in the table of layers"
    layer, entry, position = PLACES[name]
    for line, other in of_package(path, ast.walk(tree(path))):
        # The command line talks to the package as a user does.
        if other == "" and layer == len(LAYERS) - 1:
            continue
        assert other, f"{name}:{line} imports the package itself"
        below, beside, before = place_of(other)
        allowed = below < layer or (below == layer and beside == entry and before < position)
        assert allowed, f"{name}:{line} imports {other}"


@pytest.mark.parametrize("path", MODULES, ids=by_name)
def test_only_heavy_packages_are_imported_inside_functions(path):
    for node in function_nodes(path):
        for other in imported(node):
            own = other.split(".")[0] == "jhd"
            # The command line loads what a command needs, so that its help comes at once.
            allowed = name_of(path) in COMMAND_LINE if own else other.split(".")[0] in HEAVY
            assert allowed or name_of(path) in COMMAND_LINE, f"{by_name(path)}:{node.lineno} imports {other}"


def test_heavy_packages_that_are_optional_are_never_imported_with_a_module():
    optional = {"trimesh", "skimage", "svgelements", "sympy", "shapely"}
    for path in MODULES:
        inside = set(map(id, function_nodes(path)))
        outer = [node for node in ast.walk(tree(path)) if id(node) not in inside]
        found = {name.split(".")[0] for node in outer for name in imported(node)} & optional
        assert not found, f"{by_name(path)} imports {found}"


def forbidden(node):
    """What the library leaves to its callers: printing, warnings, and assertions, which -O removes."""
    if isinstance(node, ast.Assert):
        return "assert"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
        return "print"
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return ast.unparse(node) if ast.unparse(node) in ("warnings.warn", "jax.config", "os.environ") else None
    return None


@pytest.mark.parametrize("path", [path for path in MODULES if name_of(path) not in COMMAND_LINE], ids=by_name)
def test_nothing_is_printed_warned_of_asserted_or_set_globally_below_the_command_line(path):
    nodes: list[Any] = [node for node in ast.walk(tree(path)) if forbidden(node)]
    found = [(node.lineno, forbidden(node)) for node in nodes]
    assert not found, f"{by_name(path)}: {found}"


@pytest.mark.parametrize("path", [path for path in INITS if path.parent != PACKAGE], ids=by_name)
def test_the_init_file_of_a_folder_holds_names_and_a_docstring(path):
    if path.read_text(encoding="utf-8") == "":
        return
    assert ast.get_docstring(tree(path)), "no docstring"
    for node in tree(path).body[1:]:
        exported = isinstance(node, ast.ImportFrom) or (
            isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        )
        assert exported, f"line {node.lineno}: {ast.unparse(node)[:60]}"


def test_the_init_file_of_the_package_holds_names_the_version_and_the_switch_to_float64():
    docstring, *body = tree(PACKAGE / "__init__.py").body
    assert isinstance(docstring, ast.Expr)
    others = [node for node in body if not isinstance(node, ast.Import | ast.ImportFrom)]
    switches = [node for node in others if isinstance(node, ast.If)]
    names = [ast.unparse(node.targets[0]) for node in others if isinstance(node, ast.Assign)]
    assert len(switches) == 1 and "jax_enable_x64" in ast.unparse(switches[0])
    assert set(names) <= {"__version__", "__all__"} and len(names) + 1 == len(others)


def test_every_function_and_class_that_has_no_leading_underscore_has_a_docstring():
    missing = []
    for path in MODULES:
        for node in tree(path).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                missing += [] if ast.get_docstring(node) else [f"{by_name(path)}.{node.name}"]
    assert not missing
