"""A named, tagged table of pairs of implicit surfaces with true directed distances, as plain NumPy arrays.

`Case.ab` is the directed distance, max over a of min over b, `Case.ba` the other direction. Both belong to the stored
doubles taken as real numbers, in the closed boxes. Most coefficients are dyadic, so that nothing was rounded.

A value is a string of up to 34 digits: a closed form (the source says which), or a maximum that `surface_reference`
solves in 60 digits from the point and the feet given with it, after dense samples of both surfaces have shown that
there is no larger one. Points and feet name one of the maxima; a coordinate on a face of the box is exactly on it.

Tags: `smooth` all maximizers inside their boxes with one foot inside, `clipped` a point or a foot on a face, `two_foot`
and `three_foot` a maximum with that many feet, `degenerate` a family of maximizers or of feet, `singular` a surface
with a singular point or line in its box, `tangent` a foot on a face that its surface touches, `symmetric` several
maximizers, `ghost` cells that look like a surface and hold none, `boxes` different boxes, `far` large coordinates,
`scale` a size far from one, `close` distances far below the size, `coincident` distance zero. They hold for at least
one of the directions.
"""

from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np


class Surface(NamedTuple):
    """An implicit surface: coefficients[i, j, k] of x^i y^j z^k, and the corners of its box."""

    coefficients: Any
    lower: Any
    upper: Any


Point = tuple[float, float, float]


class Maximum(NamedTuple):
    """A directed distance in digits, and where one of its maxima is; no place where only a closed form is known."""

    value: str
    point: Any = None
    feet: tuple[Point, ...] = ()


@dataclass(frozen=True)
class Case:
    """A pair of surfaces with both directed distances; see the module's docstring for the tags."""

    name: str
    a: Surface
    b: Surface
    tags: frozenset[str]
    ab: Maximum
    ba: Maximum
    source: str


# ---- polynomials, exact until they are stored ------------------------------------------------------------------------


class Polynomial(dict[Any, Any]):
    """Fractions by exponents."""

    def __add__(self, other):
        total = Polynomial(self)
        for powers, c in _polynomial(other).items():
            total[powers] = total.get(powers, 0) + c
        return total

    def __neg__(self):
        return Polynomial({powers: -c for powers, c in self.items()})

    def __sub__(self, other):
        return self + -_polynomial(other)

    def __rsub__(self, other):
        return _polynomial(other) + -self

    def __mul__(self, other):
        product = Polynomial()
        for p, c in self.items():
            for q, d in _polynomial(other).items():
                powers = tuple(i + j for i, j in zip(p, q, strict=True))
                product[powers] = product.get(powers, 0) + c * d
        return product

    def __pow__(self, count):
        power = _polynomial(1)
        for _ in range(count):
            power = power * self
        return power

    __radd__, __rmul__ = __add__, __mul__


def _polynomial(value):
    return value if isinstance(value, Polynomial) else Polynomial({(0, 0, 0): Fraction(value)})


X, Y, Z = (Polynomial({powers: Fraction(1)}) for powers in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))


def surface(polynomial, lower, upper=None):
    """The surface in a box; one number is half the side of a cube about the origin. Coefficients round to doubles."""
    array = np.zeros(np.max(list(polynomial), axis=0) + 1)
    for powers, c in polynomial.items():
        array[powers] = float(c)
    corners = ((-lower,) * 3, (lower,) * 3) if upper is None else (lower, upper)
    return Surface(array, *(tuple(float(x) for x in corner) for corner in corners))


def sphere(radius, center=(0, 0, 0), about=(X, Y, Z)):
    """|x - center|^2 = radius^2."""
    pairs = zip(about, center, strict=True)
    return sum(((t - Fraction(c)) ** 2 for t, c in pairs), -_polynomial(Fraction(radius) ** 2))


def torus(major, minor, about=(X, Y, Z)):
    """A torus about the third axis."""
    u, v, w = about
    major, minor = Fraction(major), Fraction(minor)
    return (u**2 + v**2 + w**2 + (major**2 - minor**2)) ** 2 - 4 * major**2 * (u**2 + v**2)


def tanglecube(u, v, w):
    """A surface of genus five."""
    return sum((t**4 - 5 * t**2 for t in (u, v, w)), _polynomial(Fraction("11.8")))


def moved(given, offset, scale=1):
    """The polynomial of scale x + offset for the points x of another one."""
    x = [(t - Fraction(c)) * (1 / Fraction(scale)) for t, c in zip((X, Y, Z), offset, strict=True)]
    terms = (c * x[0] ** i * x[1] ** j * x[2] ** k for (i, j, k), c in given.items())
    return sum(terms, Polynomial())


def random_polynomial(seed, degree):
    """Coefficients in eighths."""
    generator = np.random.default_rng(seed)
    powers = [p for p in np.ndindex(*[degree + 1] * 3) if sum(p) <= degree]
    return Polynomial({p: Fraction(int(generator.integers(-8, 9)), 16 if sum(p) == 0 else 8) for p in powers})


def _paper_cone(width):
    return surface(X**2 * Fraction(1, width) + Y**2 * Fraction(1, 4) - Z**2 * Fraction(1, 9), 2)


_HALVES = Fraction(1, 2), Fraction(1, 4), Fraction(1, 8), Fraction(1, 16)
_HALF, _QUARTER, _EIGHTH, _SIXTEENTH = _HALVES
_ELLIPSOID = X**2 * _HALF + Y**2 + 2 * Z**2 - 1
_SHIFTED_BALL = sphere(1, (_EIGHTH, _QUARTER, 0))
_CLEBSCH = (
    81 * (X**3 + Y**3 + Z**3)
    - 189 * (X**2 * (Y + Z) + Y**2 * (X + Z) + Z**2 * (X + Y))
    + 54 * X * Y * Z
    + 126 * (X * Y + X * Z + Y * Z)
    - 9 * (X**2 + Y**2 + Z**2)
    - 9 * (X + Y + Z)
    + 1
)
_CAYLEY = 4 * (X**2 + Y**2 + Z**2) + 16 * X * Y * Z - 1
_GOLDEN = Fraction((1 + 5**0.5) / 2)
_BARTH = (
    4 * (_GOLDEN**2 * X**2 - Y**2) * (_GOLDEN**2 * Y**2 - Z**2) * (_GOLDEN**2 * Z**2 - X**2)
    - (1 + 2 * _GOLDEN) * (X**2 + Y**2 + Z**2 - 1) ** 2
)
_GENUS_TWO = 2 * Y * (Y**2 - 3 * X**2) * (1 - Z**2) + (X**2 + Y**2) ** 2 - (9 * Z**2 - 1) * (1 - Z**2)
# An isolated complex point: cells about it look as if they held a surface.
_GHOST = (X - Fraction("1.2")) ** 2 + Y**2 + Z**2 + Fraction("0.0001")
_DYADIC_GHOST = (X - Fraction(7, 4)) ** 2 + Y**2 + Z**2 + Fraction(1, 2**13)
_TILTED = X, Y * Fraction(3, 5) - Z * Fraction(4, 5), Y * Fraction(4, 5) + Z * Fraction(3, 5)
_FAR = Fraction(2**20), Fraction(-(2**20)), Fraction(2**19)

# ---- cases whose maxima are solved in many digits --------------------------------------------------------------------

_PAIRS = {
    "paper_cones": (_paper_cone(4), _paper_cone(16), "clipped two_foot singular symmetric"),
    "sphere_ellipsoid": (surface(_SHIFTED_BALL, 2), surface(_ELLIPSOID, 2), "smooth two_foot"),
    "spheres_apart": (surface(sphere(1), 3), surface(sphere(_HALF, (1, 3 * _QUARTER, _HALF)), 3), "smooth"),
    "tanglecube_shifted": (
        surface(tanglecube(X, Y, Z), 3),
        surface(tanglecube(X - _EIGHTH, Y - _SIXTEENTH, Z), 3),
        "smooth symmetric",
    ),
    "tanglecube_sphere": (
        surface(tanglecube(X, Y, Z), 3),
        surface(sphere(2, (_QUARTER, _EIGHTH, _SIXTEENTH)), 3),
        "smooth three_foot",
    ),
    "clebsch_cayley": (surface(_CLEBSCH, 1), surface(_CAYLEY, 1), "clipped two_foot singular symmetric"),
    "barth_sphere": (
        surface(_BARTH, 2),
        surface(sphere(1, (_EIGHTH, _SIXTEENTH, _SIXTEENTH / 2)), 2),
        "clipped three_foot singular",
    ),
    "genus_two_sphere": (
        surface(_GENUS_TWO, (-2, -2, -1.25), (2, 2, 1.25)),
        surface(sphere(1.25, (_EIGHTH, _SIXTEENTH, _SIXTEENTH / 2)), 2),
        "smooth two_foot boxes",
    ),
    "torus_tilted_torus": (
        surface(torus(1, 0.375), 2),
        surface(torus(1.25, _QUARTER, _TILTED), 2),
        "smooth symmetric",
    ),
    "plane_at_a_corner": (surface(Z - X * _QUARTER - Y * _EIGHTH, 1), surface(Z - _HALF, 1), "clipped"),
    "saddle_plane": (
        surface(Z - X * Y - X * _QUARTER, (-1, -1, -2), (1, 1, 2)),
        surface(Z + X * _EIGHTH, (-1, -1, -2), (1, 1, 2)),
        "clipped",
    ),
    "crossed_cylinders": (surface(X**2 + Y**2 - 1, 2), surface(Y**2 + Z**2 - 1, 2), "clipped symmetric"),
    "hyperboloid_cylinder": (
        surface(X**2 + 4 * Y**2 - Z**2 - 1, (-1.5, -1.5, -0.5), (1.5, 1.5, 0.5)),
        surface(X**2 + Y**2 - Fraction(9, 4), 1.5),
        "tangent clipped boxes symmetric",
    ),
    "spheres_in_other_boxes": (
        surface(sphere(1.5, (0, _QUARTER, _EIGHTH)), 2),
        surface(sphere(1.25), (0.25, -2, -1), (2, 0.5, 2)),
        "clipped three_foot boxes",
    ),
    "plane_across_an_ellipsoid": (
        surface(Z - X * _QUARTER - Y * _EIGHTH - _SIXTEENTH, 1),
        surface(X**2 + Y**2 * _HALF + Z**2 * Fraction(1, 3) - 1, 2),
        "smooth two_foot boxes",
    ),
    "plane_in_a_prism": (
        surface(Z - X * _HALF - Y * _QUARTER - _EIGHTH, (-0.5, -0.5, -1), (0.5, 0.5, 1)),
        surface((Y + 1) * (3 * X + 4 * Y - 5) * (-3 * X + 4 * Y - 5), 2),
        "smooth three_foot clipped boxes singular",
    ),
    "sphere_ghost_plane": (surface(sphere(1), 2), surface(_GHOST * (X + Fraction(3, 2)), 2), "smooth clipped ghost"),
    "quadrics": (surface(random_polynomial(200, 2), 1), surface(random_polynomial(300, 2), 1), "clipped"),
    "other_quadrics": (surface(random_polynomial(201, 2), 1), surface(random_polynomial(301, 2), 1), "clipped"),
    "cubics": (surface(random_polynomial(1, 3), 1), surface(random_polynomial(101, 3), 1), "clipped two_foot"),
}

_SOLVED = {
    "paper_cones": (
        Maximum(
            "0.7988595860203707677820969570800963",
            (-1.3333333333333333, 0.0, 2.0),
            (
                (-1.7777777777777777, 0.2488926457873682, 1.3846153846153846),
                (-1.7777777777777777, -0.2488926457873682, 1.3846153846153846),
            ),
        ),
        Maximum(
            "0.85247950810066689854781428596035",
            (2.0, -0.8819171036881968, 2.0),
            ((1.2199885626608373, -0.5379643898572859, 2.0),),
        ),
    ),
    "sphere_ellipsoid": (
        Maximum(
            "0.5199575215253077648111496996422106",
            (-0.8111760806969543, -0.10153142950650879, 0.0),
            (
                (-1.0815681075959391, -0.20306285901301757, -0.4323602026118551),
                (-1.0815681075959391, -0.20306285901301757, 0.4323602026118551),
            ),
        ),
        Maximum(
            "0.5762925191526317776469106767021718",
            (-1.3821577981195328, -0.21170713391069879, 0.0),
            ((-0.8311409318428639, -0.042907013324467766, 0.0),),
        ),
    ),
    "spheres_apart": (
        Maximum(
            "1.846291201783626007812677622885082",
            (-0.7427813527082074, -0.5570860145311556, -0.3713906763541037),
            ((0.6286093236458963, 0.4714569927344222, 0.31430466182294814),),
        ),
        Maximum(
            "0.8462912017836260078126776228850824",
            (1.3713906763541037, 1.028543007265578, 0.6856953381770519),
            ((0.7427813527082074, 0.5570860145311556, 0.3713906763541037),),
        ),
    ),
    "tanglecube_shifted": (
        Maximum(
            "0.1397542485937368560255733542957048",
            (2.19039370071913, 1.9473791817582098, -1.5811388300841898),
            ((2.31539370071913, 2.00987918175821, -1.5811388300841898),),
        ),
        Maximum(
            "0.1397542485937368560255733542957048",
            (-2.06539370071913, -1.8848791817582098, 1.5811388300841898),
            ((-2.19039370071913, -1.9473791817582098, 1.5811388300841898),),
        ),
    ),
    "tanglecube_sphere": (
        Maximum(
            "1.729101348418082523637831345377611",
            (-2.0232545418378813, -2.0017183313232003, -1.9906877152371794),
            ((-0.9691969750579268, -1.015606345936601, -1.0386702409794573),),
        ),
        Maximum(
            "1.265816361139943343523192875457017",
            (2.245111212439046, 0.0, 0.0),
            (
                (1.7405218608341622, 0.8208777760350594, 0.8208777760350594),
                (1.7405218608341622, -0.8208777760350594, 0.8208777760350594),
                (1.7405218608341622, 0.8208777760350594, -0.8208777760350594),
            ),
        ),
    ),
    "clebsch_cayley": (
        Maximum(
            "0.9344058026325119400749274441884579",
            (-1.0, 0.8749847251461715, -0.43190595632903717),
            (
                (-0.9640808156977111, 0.9137001733525891, 0.5010062208144189),
                (-0.3722359707348288, 0.32430785713626636, -0.01264289500253829),
            ),
        ),
        Maximum(
            "0.916404133766704914002312337585037",
            (-0.5, -1.0, -1.0),
            ((0.07926815123824703, -1.0, -0.2898979331492351),),
        ),
    ),
    "barth_sphere": (
        Maximum(
            "2.319752165803861737742047219398545",
            (-2.0, -2.0, -1.4691576753867366),
            ((-0.5151080242944707, -0.5587813176975744, -0.42071376128379456),),
        ),
        Maximum(
            "0.5094449964543851923966227380365485",
            (0.9685700166827822, 0.5986091907940121, 0.0),
            (
                (0.5284643330191471, 0.855204575825335, 0.0),
                (0.6918093739307586, 0.5909067477366057, -0.4276428690003408),
                (0.956107202019488, 0.16326387873626483, 0.2642978280887294),
            ),
        ),
    ),
    "genus_two_sphere": (
        Maximum(
            "0.9487913936605042018988428419178265",
            (0.12953997063486433, 0.06593947001673633, 0.33240474966471956),
            ((0.14384064125041665, 0.07677362110654495, 1.2810264976097845),),
        ),
        Maximum(
            "0.7472178636424138477938969714458883",
            (1.170293360087625, -0.6222519469535829, 0.0),
            (
                (0.7630645903635775, -0.355484067646784, -0.566863443366676),
                (0.7630645903635775, -0.355484067646784, 0.566863443366676),
            ),
        ),
    ),
    "torus_tilted_torus": (
        Maximum(
            "1.155776406404415137455352463993519",
            (0.0, 1.0909508593886248, 0.36380343755449945),
            ((0.0, 0.8106339062590833, -0.757464374963667),),
        ),
        Maximum(
            "0.9057764064044151374553524639935193",
            (0.0, 0.6893660937409167, -1.242535625036333),
            ((0.0, 0.9090491406113751, -0.36380343755449945),),
        ),
    ),
    "plane_at_a_corner": (
        Maximum("0.875", (-1.0, -1.0, -0.375), ((-1.0, -1.0, 0.5),)),
        Maximum(
            "0.8427009716003844053346353509326441",
            (-1.0, -1.0, 0.5),
            ((-0.7971014492753623, -0.8985507246376812, -0.3115942028985507),),
        ),
    ),
    "saddle_plane": (
        Maximum(
            "1.364382080481293018092811469743715",
            (-1.0, 1.0, -1.25),
            ((-0.8307692307692308, 1.0, 0.10384615384615385),),
        ),
        Maximum(
            "0.8338407774518508434329212501609033",
            (-1.0, 1.0, 0.125),
            ((-0.4346862832751844, 0.7556453488385343, -0.43714023897959875),),
        ),
    ),
    "crossed_cylinders": (
        Maximum(
            "1.236067977499789696409173668731276", (0.0, 1.0, 2.0), ((0.0, 0.4472135954999579, 0.8944271909999159),)
        ),
        Maximum(
            "1.236067977499789696409173668731276", (2.0, 1.0, 0.0), ((0.8944271909999159, 0.4472135954999579, 0.0),)
        ),
    ),
    "hyperboloid_cylinder": (
        Maximum("1.0", (0.0, 0.5, 0.0), ((0.0, 1.5, 0.0),)),
        Maximum("1.37311653433900420995811703410827", (0.0, 1.5, -1.5), ((0.0, 0.5590169943749475, -0.5),)),
    ),
    "spheres_in_other_boxes": (
        Maximum(
            "2.167521643746633998982750889650012",
            (-1.4563719372790032, 0.3728283907970415, -0.21248180205814432),
            ((0.25, -0.7071067811865476, -1.0), (0.25, 0.5, 1.118033988749895), (0.5590169943749475, 0.5, -1.0)),
        ),
        Maximum(
            "0.445904889105102485890475418935781",
            (0.25, 0.5, 1.118033988749895),
            ((0.3557553736129517, 0.6057553736129517, 1.538108710712314),),
        ),
    ),
    "plane_across_an_ellipsoid": (
        Maximum(
            "0.9990305378234821351983577722039771",
            (0.0, -0.0038759689922480615, 0.06201550387596899),
            (
                (-0.9985416925136373, -0.007751937984496123, 0.09302325581395349),
                (0.9985416925136373, -0.007751937984496123, 0.09302325581395349),
            ),
        ),
        Maximum(
            "1.754172034262724367794932910024237",
            (0.14213381090374028, 0.14213381090374028, -1.7056057308448835),
            ((-0.2802211827040942, -0.06904368590017694, -0.016185756413545662),),
        ),
    ),
    "plane_in_a_prism": (
        Maximum("1.0", (0.0, 0.0, 0.125), ((0.0, -1.0, 0.125), (0.6, 0.8, 0.125), (-0.6, 0.8, 0.125))),
        Maximum("2.880972058177586699101623665296616", (1.0, 2.0, -2.0), ((-0.1, 0.5, 0.2),)),
    ),
    "sphere_ghost_plane": (
        Maximum("2.499999999999999950505139435237393", (1.0, 0.0, 0.0), ((-1.5, 0.0, 0.0),)),
        Maximum(
            "2.201562118716424332187738137722232",
            (-1.5, 2.0, -2.0),
            ((-0.4685212856658182, 0.6246950475544243, -0.6246950475544243),),
        ),
    ),
    "quadrics": (
        Maximum(
            "0.6522948911355892986206552064733098",
            (1.0, 0.2784997659176543, -1.0),
            ((0.3783037520290666, 0.3993444379893726, -0.8438623508171946),),
        ),
        Maximum(
            "1.598099348057963668699004888617251", (1.0, -1.0, 1.0), ((1.0, 0.275846100141301, 0.03763922824258791),)
        ),
    ),
    "other_quadrics": (
        Maximum(
            "0.9450857029998227710064963427105798",
            (-0.802441204687925, 1.0, 1.0),
            ((-1.0, 0.4083444002851245, 0.2899991832852994),),
        ),
        Maximum(
            "1.429765407879117785819280876526094",
            (-1.0, 1.0, -1.0),
            ((-0.11173131214733606, 1.0, 0.12036059362521616),),
        ),
    ),
    "cubics": (
        Maximum(
            "1.42718665715202789364140753908297",
            (1.0, 0.695440847207671, -1.0),
            ((0.07290780495409648, -0.38962219991804714, -1.0),),
        ),
        Maximum(
            "1.051518041609504448644643232045957",
            (0.6855866430244699, -1.0, 0.19091996036365383),
            ((1.0, 0.0023275372440075296, 0.14429442156753816), (1.0, -0.49037755196595373, -0.673440724330792)),
        ),
    ),
}


def _closed(name, a, b, tags, ab, ba, source):
    """A case of closed forms."""
    ab, ba = (Maximum(x) if isinstance(x, str) else x for x in (ab, ba))
    return Case(name, a, b, frozenset(tags.split()), ab, ba, source)


def _lifted(name, new, offset, scale, tag):
    """A solved case moved and scaled by dyadic numbers, so that nothing is rounded."""
    polynomials, box = {"sphere_ellipsoid": ((_SHIFTED_BALL, _ELLIPSOID), 2)}[name]
    lower, upper = (tuple(float(scale * sign * box + c) for c in offset) for sign in (-1, 1))
    surfaces = (surface(moved(f, offset, scale), lower, upper) for f in polynomials)

    def there(maximum):
        places = np.array([maximum.point, *maximum.feet]) * float(scale) + np.array(offset, float)
        point, *feet = (tuple(x) for x in places.tolist())
        return Maximum(
            str(Context(prec=34).multiply(Decimal(maximum.value), Decimal(float(scale)))), point, tuple(feet)
        )

    tags = frozenset({*_PAIRS[name][2].split(), tag})
    a, b = surfaces
    ab, ba = (there(m) for m in _SOLVED[name])
    return Case(new, a, b, tags, ab, ba, f"{name}, moved and scaled exactly")


_BALL, _FLAT = sphere(1), (-1, -1, 2)
_CLOSED = (
    _closed(
        "concentric_spheres",
        surface(_BALL, 2),
        surface(sphere(1.5), 2),
        "degenerate",
        "0.5",
        "0.5",
        "radii",
    ),
    _closed(
        "parallel_planes",
        surface(Z - _QUARTER, 1),
        surface(Z + _HALF, 1),
        "degenerate clipped",
        "0.75",
        "0.75",
        "heights",
    ),
    _closed(
        "coaxial_cylinders",
        surface(X**2 + Y**2 - 1, 2),
        surface(X**2 + Y**2 - Fraction(9, 4), 2),
        "degenerate clipped",
        "0.5",
        "0.5",
        "radii",
    ),
    _closed(
        "torus_coaxial_sphere",
        surface(torus(1, 0.375), 2),
        surface(sphere(1.25), 2),
        "degenerate",
        "0.625",
        "1.225781059358212171622054418655453",
        "5/4 - (1 - 3/8); from a pole sqrt(41)/4 - 3/8, its feet a circle",
    ),
    _closed(
        "coaxial_tori",
        surface(torus(1, 0.375), 2),
        surface(torus(1.25, 0.25), 2),
        "degenerate",
        "0.375",
        "0.375",
        "two circles in the half-plane; back, each point of the core of a has a circle of feet",
    ),
    _closed(
        "ghost_sphere",
        surface(_DYADIC_GHOST * _BALL, 2),
        surface(sphere(1.125), 2),
        "degenerate ghost",
        "0.125",
        "0.125",
        "radii",
    ),
    _closed(
        "apex_over_a_plane",
        surface(X**2 + Y**2 - Z**2, (-2, -2, 0), (2, 2, 2)),
        surface(Z - X * _EIGHTH - Y * _SIXTEENTH - Fraction(5, 2), _FLAT, (1, 1, 3)),
        "singular clipped boxes",
        "2.475937842360691508621016317949577",
        "1.767766952966368811002110905262123",
        "from the apex (5/2) / sqrt(1 + 1/64 + 1/256); back 5 sqrt(2) / 4, a circle of feet",
    ),
    _closed(
        "sphere_over_an_apex",
        surface(sphere(0.5, (0, 0, 1.5)), (-2, -2, -2), (2, 2, 3)),
        surface(X**2 + Y**2 - Z**2, (-2, -2, -2), (2, 2, 0)),
        "singular clipped degenerate boxes",
        "2",
        "3.531128874149274826183306615151886",
        "the foot is the apex; back from the rim sqrt(65)/2 - 1/2",
    ),
    _closed(
        "torus_ellipsoid",
        surface(torus(1, 0.375), 2),
        surface((X - _EIGHTH) ** 2 * _HALF + Y**2 + 2 * Z**2 - 1, 2),
        "two_foot degenerate",
        Maximum(
            "0.6454972243679028141965442332970666",
            (0.625, 0.0, 0.0),
            ((0.7916666666666666, 0.0, 0.6236095644623235), (0.7916666666666666, 0.0, -0.6236095644623235)),
        ),
        "0.8481491119238079224449433959601502",
        "solved; back from the axis, a circle of feet: sqrt(383)/16 - 3/8",
    ),
    _closed(
        "near_spheres",
        surface(_BALL, 2),
        surface(sphere(1, (Fraction(1, 2**20), 0, 0)), 2),
        "smooth close symmetric",
        "0.00000095367431640625",
        "0.00000095367431640625",
        "the distance of the centers, 2^-20",
    ),
    _closed("one_sphere", surface(_BALL, 2), surface(_BALL, 2), "coincident degenerate", "0", "0", "the same set"),
)

CASES = (
    *(
        Case(name, a, b, frozenset(tags.split()), _SOLVED[name][0], _SOLVED[name][1], "solved in 60 digits")
        for name, (a, b, tags) in _PAIRS.items()
    ),
    _lifted("sphere_ellipsoid", "far_sphere_ellipsoid", _FAR, 1, "far"),
    _lifted("sphere_ellipsoid", "tiny_sphere_ellipsoid", (0, 0, 0), Fraction(1, 2**10), "scale"),
    *_CLOSED,
)
BY_NAME = {case.name: case for case in CASES}
# One of each tag, of all degrees, for the slow tests of searches, which share them out.
SLOW = (
    *("paper_cones", "barth_sphere", "plane_in_a_prism", "sphere_ghost_plane", "near_spheres"),
    *("far_sphere_ellipsoid", "tiny_sphere_ellipsoid", "concentric_spheres", "one_sphere"),
)
