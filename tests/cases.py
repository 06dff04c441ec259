"""A named, tagged table of pairs of curves with true distances, as plain NumPy arrays.

`Case.exact_ab` is the directed distance max over a of min over b, `exact_ba` the other direction. Both belong to the
*stored floats* taken as real numbers. Wherever possible the control points are dyadic rationals, so that nothing at all
was rounded: circles are quarters with control points center + radius (+-1, +-1) and weights 1, 1, 2, for which the
rational curve is (1 - t^2, 2 t) / (1 + t^2) exactly, with no square root stored.

Values are strings of up to 30 digits. They come from a closed form (the source says which), or from Newton's method in
60 digits on the equations of the event that the reference found (`DIGITS`). A tuple (lower, upper) is an interval that
is known to hold the value; None would mean that only the reference knows.

Tags. An event tag is true for the direction from a to b, at every maximizer. A pair with maximizers of different kinds,
with a continuum of feet or with a point-curve on side a has none.

- `a_end`: a free end or an isolated point of a; `corner`: a C0 joint of a;
- `b_end`: one foot, which is a free end, an isolated point or a corner of b; `antipodal`: one foot inside b;
- `one_to_two`: two feet, and one of `foot_and_foot`, `foot_and_end`, `end_and_end`; a corner of b counts as an end;
- `coincident`: the distance is zero.

The other tags describe the shapes: `tie` several maximizers, `near_tie` several maxima that float64 cannot tell apart,
`flat` distance constant along a stretch, `center` a meets a center of curvature of b, `far` coordinates large against
the shape, `scale` sizes far from 1, `close` distance small against the size, and the names of kinds of curve.
"""

from dataclasses import dataclass
from math import comb, cos, pi, sin
from typing import NamedTuple

import numpy as np

EVENTS = ("a_end", "b_end", "antipodal", "one_to_two", "corner", "coincident")
FEET = ("foot_and_foot", "foot_and_end", "end_and_end")


class Shape(NamedTuple):
    """A curve as arrays: control_points (segments, points, dim), weights None or (segments, points)."""

    control_points: np.ndarray
    weights: np.ndarray | None = None


Exact = str | tuple[float, float] | None


@dataclass(frozen=True)
class Case:
    """A pair of shapes with what is known of both directed distances; see the module's docstring for the tags."""

    name: str
    a: Shape
    b: Shape
    tags: frozenset[str]
    exact_ab: Exact
    exact_ba: Exact
    source: str


# ---- shapes --------------------------------------------------------------------------------------


def bezier(*points, weights=None):
    """One Bezier segment."""
    return Shape(np.array([points], dtype=float), None if weights is None else np.array([weights], dtype=float))


def polyline(*points, closed=False):
    """Segments of degree 1 through the points."""
    rows = np.array(points if not closed else (*points, points[0]), dtype=float)
    return Shape(np.stack([rows[:-1], rows[1:]], axis=1))


def point_set(*points):
    """A segment of degree 0 for each point."""
    return Shape(np.array(points, dtype=float)[:, None])


def together(*shapes):
    """Several contours of one degree as one shape."""
    weights = None
    if any(shape.weights is not None for shape in shapes):
        sizes = [shape.control_points.shape[:2] for shape in shapes]
        parts = [np.ones(n) if shape.weights is None else shape.weights for n, shape in zip(sizes, shapes, strict=True)]
        weights = np.concatenate(parts)
    return Shape(np.concatenate([shape.control_points for shape in shapes]), weights)


def ellipse(center, radius_x, radius_y, weights=(1, 1, 2)):
    """Four exact quarters, counter-clockwise from angle 0. Any weights with w0 w2 = 2 w1^2 give the same curve."""
    corners = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)], dtype=float)
    quarters = np.stack([corners[i : i + 3] for i in (0, 2, 4, 6)])
    return Shape(np.array(center) + quarters * (radius_x, radius_y), np.tile(np.array(weights, dtype=float), (4, 1)))


def circle(center, radius, weights=(1, 1, 2)):
    """An exact circle."""
    return ellipse(center, radius, radius, weights)


def rounded_circle(center, radius, arcs, turn):
    """A circle in equal arcs from the angle `turn`: rounded control points, weights 1, cos(half the angle), 1."""
    half = pi / arcs
    angles = [turn + half * k for k in range(2 * arcs + 1)]
    reach = [radius / cos(half) if k % 2 else radius for k in range(2 * arcs + 1)]
    rows = np.array([(center[0] + r * cos(x), center[1] + r * sin(x)) for r, x in zip(reach, angles, strict=True)])
    # The seam is one point, not two that differ by rounding.
    rows[-1] = rows[0]
    return Shape(np.stack([rows[2 * k : 2 * k + 3] for k in range(arcs)]), np.tile([1.0, cos(half), 1.0], (arcs, 1)))


def closed_cubic_bspline(integers, unit):
    """A uniform closed cubic B-spline with control points 6 * integers * unit, as Bezier segments without any rounding.

    Segment i has the Bezier points (p0 + 4 p1 + p2)/6, (2 p1 + p2)/3, (p1 + 2 p2)/3, (p1 + 4 p2 + p3)/6.
    """
    p0, p1, p2, p3 = (np.roll(np.asarray(integers, dtype=np.int64), -k, axis=0) for k in range(4))
    rows = np.stack([p0 + 4 * p1 + p2, 4 * p1 + 2 * p2, 2 * p1 + 4 * p2, p1 + 4 * p2 + p3], axis=1)
    return Shape(rows * float(unit))


def wavy(count, waves, height, center=(0.0, 0.0), phase=0.0):
    """A closed cubic B-spline round a circle of radius about 1, with `waves` waves of relative height `height`."""
    unit = 2.0**-20
    rows = []
    for k in range(count):
        angle = 2 * pi * k / count
        radius = 1 + height * cos(waves * angle + phase) + 0.5 * height * sin((waves + 1) * angle)
        rows.append((center[0] + radius * cos(angle), center[1] + radius * sin(angle)))
    return closed_cubic_bspline(np.rint(np.array(rows) / (6 * unit)), unit)


def random_bezier(seed, degree, dim=2, segments=1, weight_exponent=None):
    """Control points on a grid of 1/16 in [-4, 4], joined segments; weights 10^u with |u| <= weight_exponent."""
    rng = np.random.default_rng(seed)
    rows = rng.integers(-64, 65, size=(segments * degree + 1, dim)) / 16
    points = np.stack([rows[k * degree : k * degree + degree + 1] for k in range(segments)])
    if weight_exponent is None:
        return Shape(points)
    # Powers of two near the wanted powers of ten: the weights are stored exactly on every machine.
    reach = round(weight_exponent * 3.3)
    return Shape(points, 2.0 ** rng.integers(-reach, reach + 1, size=points.shape[:2]))


# ---- what is done to shapes: exact for the dyadic numbers used here ------------------------------


def reverse(shape):
    weights = None if shape.weights is None else shape.weights[::-1, ::-1]
    return Shape(shape.control_points[::-1, ::-1], weights)


def shift(shape, *offset):
    return Shape(shape.control_points + np.array(offset, dtype=float), shape.weights)


def scale(shape, factor):
    return Shape(shape.control_points * factor, shape.weights)


def space(shape, first, second):
    """A planar shape with its coordinates as those numbered first and second of three."""
    points = np.zeros((*shape.control_points.shape[:-1], 3))
    points[..., first], points[..., second] = shape.control_points[..., 0], shape.control_points[..., 1]
    return Shape(points, shape.weights)


def elevate(shape):
    """The same polynomial curve one degree higher."""
    points = shape.control_points
    degree = points.shape[1] - 1
    ratio = (np.arange(degree + 2) / (degree + 1))[:, None]
    first, last = np.pad(points, ((0, 0), (1, 0), (0, 0))), np.pad(points, ((0, 0), (0, 1), (0, 0)))
    return Shape(ratio * first + (1 - ratio) * last)


def halves(shape):
    """Every segment cut at 1/2."""
    rows, left, right = shape.control_points, [], []
    while rows.shape[1]:
        left.append(rows[:, 0])
        right.append(rows[:, -1])
        rows = (rows[:, :-1] + rows[:, 1:]) / 2
    parts = np.stack([np.stack(left, 1), np.stack(right[::-1], 1)], axis=1)
    return Shape(parts.reshape(-1, *shape.control_points.shape[1:]))


def part(shape, keep):
    """Some of the segments."""
    return Shape(shape.control_points[keep], None if shape.weights is None else shape.weights[keep])


def graph(*coefficients, start=0.0, stop=1.0):
    """The graph y = sum c_k x^k over [start, stop] as one Bezier segment, from power to Bernstein coefficients."""
    degree = len(coefficients) - 1
    polynomial = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([start, stop - start])).coef
    polynomial = np.pad(polynomial, (0, degree + 1 - len(polynomial)))
    y = [sum(comb(i, k) / comb(degree, k) * polynomial[k] for k in range(i + 1)) for i in range(degree + 1)]
    x = [start + (stop - start) * i / degree for i in range(degree + 1)]
    return bezier(*zip(x, y, strict=True))


# ---- the table -----------------------------------------------------------------------------------

PARABOLA = bezier((-2, 4), (0, -4), (2, 4))
CUSP = bezier((0, 0), (1, 1), (0, 1), (1, 0))
LOOP = bezier((0, 0), (6, 4), (-2, 4), (4, 0))
WAVE = bezier((0, 0), (1, 2), (3, -2), (4, 1))
ARCH = bezier((0, 0), (1, 3), (3, 3), (4, 0))
UNIT = circle((0, 0), 1)
SPLINE_12, SPLINE_12_B = wavy(12, 3, 0.25), wavy(12, 2, 0.375, center=(0.125, 0.0625), phase=0.5)
SPLINE_30, SPLINE_30_B = wavy(30, 5, 0.1875), wavy(30, 4, 0.125, center=(0.0625, -0.0625), phase=1.0)
SPLINE_90, SPLINE_90_B = wavy(90, 13, 0.0625), wavy(90, 11, 0.09375, center=(0.03125, 0.015625), phase=0.25)
SQUARE = polyline((1, -1), (1, 1), (-1, 1), (-1, -1), closed=True)
SQRT_2 = "1.41421356237309504880168872421"
# In 60 digits the circles of rounded control points and weights leave their circle by at most 3.1e-16.
ROUNDED = (0.0, 1e-15)

TABLE: list[Case] = []


def add(name, a, b, tags, ab: Exact = None, ba: Exact = None, source=""):
    """Put a case into the table; values that are not given are looked up in DIGITS."""
    stored = DIGITS.get(name, (None, None))
    exact_ab, exact_ba = (stored[0] if ab is None else ab), (stored[1] if ba is None else ba)
    closed = [] if ab is None and ba is None and not source else [source or "closed form"]
    solved = ["event equations in 60 digits"] if (exact_ab, exact_ba) != (ab, ba) else []
    TABLE.append(Case(name, a, b, frozenset(tags.split()), exact_ab, exact_ba, "; ".join(closed + solved)))


def same_set(tags):
    """The tags and values of a pair whose two distances are 0."""
    return {"tags": f"coincident {tags}", "ab": "0", "ba": "0", "source": "the same point set"}


# Directed distances of the stored floats, a to b and b to a, to 30 digits; None where the table has a closed form.
DIGITS: dict[str, tuple[str | None, str | None]] = {
    "cusp_over_chord": (None, "0.369008729828190495794971741068"),
    "chord_under_cusp": ("0.369008729828190495794971741068", None),
    "parabola_through_center": (None, "1.0"),
    "points_to_segment": (None, "2.97321374946370110452240164279"),
    "jts_lines_densified": (None, "55.8779333828715847561485828693"),
    "roof_over_segment": (None, "1.66410058867568736605502520037"),
    "spike_over_parabola": (None, "1.0"),
    "point_curve_over_parabola": (None, "2.82842712474619009760337744842"),
    "focus_line_of_parabola": (None, "2.01556443707463741309165330758"),
    "part_of_a_wave": (None, "1.45681654751893863844570358574"),
    "wave_and_its_part": ("1.45681654751893863844570358574", None),
    "shared_stretch_of_waves": ("1.01778526191270012479143750197", "2.01068896326212823013463708223"),
    "quarter_circle_cubic": ("0.000196076469876883100700485544723", "0.000196076469876883100700485544723"),
    "quarter_circle_kappa": ("0.000272530000318322219798345331881", "0.000272530000318322219798345331881"),
    "twisted_cubic": ("0.2066108707063841627585335258", "0.2066108707063841627585335258"),
    "wave_over_line": ("0.886953397982576992023501365865", "0.881457364970784631778271460797"),
    "line_under_wave": ("0.881457364970784631778271460797", "0.886953397982576992023501365865"),
    "arch_and_wave": ("2.01068896326212823013463708223", "1.80037240681482084891099467263"),
    "wave_and_arch": ("1.80037240681482084891099467263", "2.01068896326212823013463708223"),
    "loop_and_line": ("3.0", "1.20062216336521201295714956606"),
    "line_and_loop": ("1.80277563773199464655961063374", "1.74525004624489270307552647943"),
    "loop_and_cusp": ("0.47644768591545330949480872684", "0.434099281815425289104927713185"),
    "cusp_and_loop": ("0.434099281815425289104927713185", "0.47644768591545330949480872684"),
    "segment_inside_loop": ("0.659496113732779262319446369201", "2.4596747752497686660500910356"),
    "evolute_of_parabola": (None, "4.03112887414927482618330661515"),
    "along_evolute": (None, "3.91311896062463196871605392028"),
    "across_evolute": ("0.762644532906381760888496139155", "3.67636029246318565990341447259"),
    "line_along_axis": ("1.14260910006684068748931190818", "2.69258240356725201562535524577"),
    "wide_valley": ("1.21628892479360033056350662486", "3.16227766016837933199889354443"),
    "between_two_arches": ("0.5", "2.25"),
    "between_two_circles": ("2.0763637802481550372455499071", "2.49596760179306892305152581765"),
    "foot_and_end_1": ("1.40838529040654931186273406985", "5.03115294937452681692064075465"),
    "foot_and_end_2": ("1.97198984091233587044380705198", "4.43760156980183297614673386766"),
    "foot_and_end_3": ("1.58225700570606545940807477013", "2.44948974278317809819728407471"),
    "foot_and_end_of_hook": ("1.06748414458791640700130538397", "3.3971353902797189928885403282"),
    "end_and_end_1": ("1.52581945196671286898723190708", "2.87130795478312986277636240417"),
    "end_and_end_2": ("2.40108984907615314390433156394", "0.384228607454829966792121942583"),
    "end_and_end_of_horseshoe": ("1.52721393115754557197042934839", "5.1052107630317027704547273566"),
    "end_and_end_in_space": ("2.59119387817386491403327881472", "5.81459575632939503866182634056"),
    "b_end_of_ray": ("4.00208879671811618201882343333", "4.03112887414927482618330661515"),
    "b_end_of_arch": ("3.51439160989937506133456768898", "1.91160989758598415899752057384"),
    "b_end_in_space": ("3.72169354823642326588480189156", "5.83095189484530047087415287755"),
    "b_end_at_corner": ("2.64885125785453129945214844186", "3.64005494464025913554865124576"),
    "b_end_at_cusp_joint": ("2.28340299582053080170745154857", "2.82842712474619009760337744842"),
    "a_end_of_wave": ("2.23606797749978969640917366873", "0.144784570567694176874695176439"),
    "a_end_in_space": ("5.97351315433240580185277841467", "2.12132466934149852911452753227"),
    "a_end_of_rational": ("4.39733879068672057616190627509", "3.29803014204898354524031929829"),
    "corner_of_cubics": ("4.43381805602171069048610157147", "1.41424607882811871321791353104"),
    "corner_of_polyline": ("3.0", "1.11552189778681561979984237163"),
    "corner_in_space": ("3.74165738677394138558374873232", "1.88685409317006582560643418035"),
    "corner_inside_circle": ("0.720491502812526287948853291409", "1.27950849718747371205114670859"),
    "star_in_ellipse": ("1.88802167634276276982327463255", "2.12354384653571874923658534316"),
    "ellipse_and_offset": ("1.26732948823037073413279147159", "1.26732948823037073413279147159"),
    "ellipses_crossed": ("2.12518099320578172553634103872", "2.06322829715641428085401022459"),
    "light_and_heavy_weights": ("1.89547111423399436192290082994", "5.98801198801198801186336132372"),
    "heavy_and_light_weights": ("5.98801198801198801186336132372", "1.89547111423399436192290082994"),
    "weights_in_the_thousands": ("1.62440124933462592632156658823", "2.06078058937026335967097446894"),
    "rational_against_polynomial": ("1.81005185896383279423810579277", "1.0"),
    "rational_space_curves": ("3.45357329450266995300602280464", "5.39315246563736613950114258768"),
    "degrees_1_and_10": ("1.78272154600733124745832042232", "2.19757585365964711475093998355"),
    "degrees_2_and_5": ("2.35955288147572416000024023081", "2.16317409753277189151706435494"),
    "degrees_3_and_3": ("1.53167462271608931390441640503", "2.1781909567435833039459297038"),
    "degrees_4_and_7": ("1.88198045481450205830222847407", "1.67206586490217147154527768871"),
    "degrees_5_and_2": ("3.15210612891826696047346075303", "1.41776446845023268168279667491"),
    "degrees_6_and_6": ("3.14960092237898181692588283545", "3.00264930300854197564361590615"),
    "degrees_7_and_4": ("4.60719920470801754592965872857", "3.31464269250838245091029850681"),
    "degrees_8_and_1": ("3.53408737753985130412577292338", "1.75852336627371577217729987337"),
    "degrees_9_and_3": ("3.80045707100491449603057902871", "2.84741049196222226710888933969"),
    "degrees_10_and_10": ("2.45495606061806489168082157978", "1.81680523171857912833245360584"),
    "degrees_0_and_9": ("3.41984734967403276202782851463", "3.33365883827364674140136433795"),
    "degrees_9_and_0": ("3.33365883827364674140136433795", "3.41984734967403276202782851463"),
    "space_cubics": ("6.32273662754686248175429037097", "5.87167459077902238613270325339"),
    "space_cubic_chains": ("3.55041810918094546607204378958", "3.28110563384554404451621983931"),
    "cubic_chains": ("1.30152529242633750766077509791", "1.44803574554984692223806623385"),
    "degree_10_in_space": ("2.55294867947220945101902078572", "2.22643914131960948150117205008"),
    "splines_12": ("0.489985270345751834560607377358", "0.489985270345751834560607377358"),
    "splines_30": ("0.318499330610227480057528656362", "0.300963081686199882033490793859"),
    "splines_90": ("0.161211990168213870222350835664", "0.184067701080784687067254159264"),
    "curve_and_spline_90": ("0.841691904858498401851697816806", "1.01245020540780916059294686484"),
    "splines_12_far_million": ("0.489985270345751834560607377358", "0.489985270345751834560607377358"),
    "arch_and_wave_far_million": ("0.00196356344068567209974085652561", "0.00175817617853009848526464323499"),
    "loop_far_hundred_million": ("0.47644768591545330949480872684", "0.434099281815425289104927713185"),
    "arch_and_wave_small": ("1.82871095900020757665937442855e-12", "1.6374291652162545223391086189e-12"),
    "arch_and_wave_large": ("2210775894947.58047328937675392", "1979530395619.95854698794990945"),
    "circle_in_ellipse_small": ("7.42599314369477754310017212358e-13", "9.094947017729282379150390625e-13"),
    "circle_in_ellipse_large": ("897747484769.382566459802594721", "1099511627776.0"),
    "figure_eight": (None, "1.15260859665503997419268920546"),
    "circle_and_figure_eight": ("1.15260859665503997419268920546", None),
}


def closed_forms():
    add(
        "segment_over_parabola",
        bezier((-0.5, 2), (0.5, 2)),
        PARABOLA,
        "one_to_two foot_and_foot",
        "1.32287565553229529525080787682",
        "2.5",
        "y = x^2 from (0, 2): sqrt(7)/2; back from its ends",
    )
    add(
        "segment_over_parabola_in_space",
        bezier((-0.5, 2, 0), (0.5, 2, 0)),
        bezier((-2, 4, 1), (0, -4, 1), (2, 4, 1)),
        "one_to_two foot_and_foot space",
        "1.65831239517769992455746636834",
        "2.69258240356725201562535524577",
        "the same a unit apart: sqrt(7/4 + 1), sqrt(25/4 + 1)",
    )
    add("cusp_over_chord", CUSP, bezier((0, 0), (1, 0)), "antipodal cusp", "0.75", None, "height 3 t (1-t) at 1/2")
    add("chord_under_cusp", bezier((0, 0), (1, 0)), CUSP, "one_to_two foot_and_foot cusp", None, "0.75")
    add(
        "circle_in_ellipse",
        UNIT,
        ellipse((0, 0), 2, 1),
        "one_to_two foot_and_foot tie rational closed",
        "0.816496580927726032732428024902",
        "1",
        "from (1, 0) to cos = 2/3: sqrt(2/3)",
    )
    add(
        "ellipse_round_circle",
        ellipse((0, 0), 2, 1),
        UNIT,
        "antipodal tie rational closed",
        "1",
        "0.816496580927726032732428024902",
    )
    add("concentric_circles", UNIT, circle((0, 0), 2), "antipodal flat rational closed", "1", "1")
    add("disjoint_circles", UNIT, circle((3, 0), 1), "antipodal rational closed", "3", "3")
    add("eccentric_circles", UNIT, circle((0.5, 0), 3), "antipodal rational closed", "2.5", "2.5")
    add("circle_around_its_center", UNIT, point_set((0, 0)), "b_end flat rational closed degree_0 center", "1", "1")
    add("center_of_a_circle", point_set((0, 0)), UNIT, "flat rational closed degree_0 center", "1", "1")
    add("circle_around_a_point", UNIT, point_set((0.5, 0)), "b_end rational closed degree_0", "1.5", "0.5")
    add("circle_around_a_segment", circle((0, 0), 2), bezier((0.5, 0), (1, 0)), "b_end rational closed", "2.5", "1.5")
    add(
        "chord_through_center",
        bezier((-0.5, 0), (0.75, 0)),
        UNIT,
        "center rational line",
        "1",
        "1",
        "1 - |x| inside the circle",
    )
    add(
        "parabola_through_center",
        bezier((-0.5, 0.25), (0, -0.25), (0.5, 0.25)),
        UNIT,
        "center rational",
        "1",
        None,
        "1 - |p| inside the circle",
    )
    add(
        "polyline_with_corner_at_center",
        polyline((-0.5, 0.5), (0, 0), (0.5, 0.5)),
        UNIT,
        "center rational corner",
        "1",
        "1",
        "1 - |p| inside the circle",
    )
    add(
        "square_round_circle",
        SQUARE,
        UNIT,
        "corner tie rational closed",
        "0.414213562373095048801688724210",
        "0.292893218813452475599155637895",
        "sqrt(2) - 1 and 1 - sqrt(1/2)",
    )
    add(
        "circle_in_square",
        UNIT,
        SQUARE,
        "one_to_two foot_and_foot tie rational closed polyline",
        "0.292893218813452475599155637895",
        "0.414213562373095048801688724210",
        "1 - sqrt(1/2) and sqrt(2) - 1",
    )
    add(
        "circles_across_in_space",
        space(UNIT, 0, 1),
        space(UNIT, 0, 2),
        "center tie rational closed space",
        SQRT_2,
        SQRT_2,
        "d^2 = 2 - 2 |cos|; all of b is equally far from (0, 1, 0)",
    )
    add(
        "linked_circles",
        space(UNIT, 0, 1),
        shift(space(UNIT, 0, 2), 1, 0, 0),
        "flat rational closed space",
        "1",
        "1",
        "d^2 = cos^2 + sin^2 everywhere on either",
    )
    add(
        "coaxial_circles",
        space(UNIT, 0, 1),
        shift(space(circle((0, 0), 4), 0, 1), 0, 0, 4),
        "antipodal flat rational closed space",
        "5",
        "5",
        "3 in the plane, 4 along the axis",
    )
    add("parallel_segments", bezier((0, 0), (4, 0)), bezier((0, 1), (4, 1)), "flat line", "1", "1")
    add("crossing_segments", bezier((-1, 0), (1, 0)), bezier((0, -1), (0, 1)), "a_end tie line", "1", "1")
    add("overlapping_segments", bezier((0, 0), (2, 0)), bezier((1, 0), (3, 0)), "a_end line", "1", "1")
    add(
        "segment_beyond_segment",
        bezier((0, 0), (1, 0)),
        bezier((4, 4), (4, 9)),
        "a_end line",
        "5.65685424949238019520675489684",
        "9.48683298050513799599668063330",
        "4 sqrt(2) and sqrt(9 + 81)",
    )
    add(
        "skew_segments",
        bezier((0, 0, 0), (4, 0, 0)),
        bezier((1, 0, 2), (1, 3, 2)),
        "a_end line space",
        "3.60555127546398929311922126747",
        "3.60555127546398929311922126747",
        "sqrt(13) both ways",
    )
    add(
        "points_scipy",
        point_set((1, 0), (0, 1), (-1, 0), (0, -1)),
        point_set((2, 0), (0, 2), (-2, 0), (0, -4)),
        "a_end degree_0",
        "2.23606797749978969640917366873",
        "3",
        "example of scipy.spatial.distance.directed_hausdorff",
    )
    add(
        "points_to_segment",
        point_set((0, 2), (5, 1), (-1, -1)),
        bezier((0, 0), (4, 0)),
        "a_end degree_0 line",
        "2",
        None,
    )
    add(
        "segment_to_points",
        bezier((0, 0), (4, 0)),
        point_set((0, 1), (3, 1)),
        "one_to_two end_and_end degree_0 line",
        "1.80277563773199464655961063374",
        "1",
        "at 3/2: sqrt(13)/2",
    )
    add(
        "jts_lines_1",
        bezier((0, 0), (2, 1)),
        bezier((0, 0), (2, 0)),
        "a_end line",
        "1",
        "0.894427190999915878563669467493",
        "JTS DiscreteHausdorffDistanceTest; back 2/sqrt(5)",
    )
    add(
        "jts_lines_2",
        bezier((0, 0), (2, 0)),
        polyline((0, 1), (1, 2), (2, 1)),
        "one_to_two end_and_end polyline",
        SQRT_2,
        "2",
        "JTS DiscreteHausdorffDistanceTest, whose 2 is the other direction",
    )
    add(
        "jts_lines_and_points",
        bezier((0, 0), (2, 0)),
        point_set((0, 1), (1, 0), (2, 1)),
        "a_end tie degree_0",
        "1",
        "1",
        "JTS DiscreteHausdorffDistanceTest",
    )
    add(
        "jts_lines_densified",
        polyline((10, 10), (10, 150), (130, 10)),
        polyline((130, 0), (0, 0), (0, 150)),
        "one_to_two foot_and_foot polyline",
        "74.6153846153846153846153846154",
        None,
        "JTS reports 14.14, and 70 when densified by 1/2: those are samples; the truth is 970/13",
    )
    add("roof_over_segment", polyline((0, 0), (2, 3), (4, 0)), bezier((0, 0), (4, 0)), "corner polyline", "3", None)
    add(
        "spike_over_parabola",
        polyline((-1, 4), (0, -2), (1, 4)),
        PARABOLA,
        "corner polyline",
        "2",
        None,
        "below the vertex",
    )
    add("hook", polyline((0, 0), (8, 0), (8, 5), (6, 5)), polyline((0, 0), (8, 0)), "flat polyline", "5", "0")
    add(
        "point_curve_over_parabola",
        bezier((0, 2), (0, 2), (0, 2), (0, 2)),
        PARABOLA,
        "point_curve",
        "1.32287565553229529525080787682",
        None,
        "sqrt(7)/2",
    )
    add(
        "segment_to_point_curve",
        bezier((0, 0), (4, 0)),
        bezier((1, 1), (1, 1), (1, 1)),
        "a_end point_curve",
        "3.16227766016837933199889354443",
        "1",
        "sqrt(10)",
    )
    add("two_point_curves", bezier((0, 0), (0, 0)), bezier((3, 4), (3, 4), (3, 4), (3, 4)), "point_curve", "5", "5")
    add("two_points", point_set((0, 0, 0)), point_set((2, 3, 6)), "a_end degree_0 space", "7", "7")
    add(
        "two_holes",
        together(circle((0, 0), 3), UNIT),
        circle((0, 0), 3),
        "antipodal flat contours rational closed",
        "2",
        "0",
    )
    add(
        "letter_contours",
        together(SQUARE, scale(SQUARE, 0.5)),
        scale(SQUARE, 2),
        "contours polyline closed flat",
        "1.5",
        SQRT_2,
        "the inner sides are 3/2 away; back from a corner",
    )
    add(
        "focus_line_of_parabola",
        bezier((0.25, 0.5), (0.25, 3)),
        together(bezier((-1, 0), (0, 0), (1, 0)), bezier((0.25, 2), (1, 3), (0, 5))),
        "one_to_two foot_and_end contours",
        "1",
        None,
        "halfway between (1/4, 0) and (1/4, 2)",
    )


def coincidences():
    add("identical_wave", WAVE, WAVE, **same_set("smooth"))
    add("reversed_wave", WAVE, reverse(WAVE), **same_set("smooth reversed"))
    add("elevated_wave", WAVE, elevate(WAVE), **same_set("smooth elevated"))
    add("halved_wave", WAVE, halves(halves(WAVE)), **same_set("smooth subdivided"))
    add("identical_loop", LOOP, reverse(LOOP), **same_set("loop reversed"))
    add("identical_cusp", CUSP, halves(CUSP), **same_set("cusp subdivided"))
    add("identical_points", point_set((0, 0), (1, 2)), point_set((1, 2), (0, 0), (0, 0)), **same_set("degree_0"))
    add("circle_in_two_parametrizations", UNIT, circle((0, 0), 1, weights=(2, 1, 1)), **same_set("rational closed"))
    add("identical_spline_12", SPLINE_12, part(SPLINE_12, np.r_[5:12, 0:5]), **same_set("spline closed"))
    add(
        "part_of_a_wave",
        part(halves(halves(WAVE)), slice(1, 3)),
        WAVE,
        "coincident subdivided",
        "0",
        None,
        "a is a part of b",
    )
    add(
        "wave_and_its_part",
        WAVE,
        part(halves(halves(WAVE)), slice(1, 3)),
        "a_end subdivided",
        None,
        "0",
        "b is a part of a",
    )
    add("segment_folded", bezier((0, 0), (2, 0), (0, 0)), bezier((0, 0), (1, 0)), **same_set("line cusp"))
    add(
        "shared_stretch", polyline((0, 0), (4, 0), (4, 3)), polyline((0, 0), (4, 0), (7, 0)), "a_end polyline", "3", "3"
    )
    add(
        "shared_stretch_of_waves",
        halves(WAVE),
        together(part(halves(WAVE), slice(0, 1)), part(halves(ARCH), slice(1, 2))),
        "one_to_two foot_and_end contours",
    )
    add(
        "circle_rounded",
        UNIT,
        rounded_circle((0, 0), 1, 4, 0.0),
        "rational closed close",
        ROUNDED,
        ROUNDED,
        "rounding of b",
    )
    add(
        "circle_in_thirds",
        UNIT,
        rounded_circle((0, 0), 1, 3, 0.0),
        "rational closed close",
        ROUNDED,
        ROUNDED,
        "rounding of b",
    )
    add(
        "circle_turned",
        rounded_circle((0, 0), 1, 4, 0.0),
        rounded_circle((0, 0), 1, 4, pi / 18),
        "rational closed close",
        ROUNDED,
        ROUNDED,
        "rounding of both",
    )
    add(
        "shifted_spline",
        SPLINE_12,
        shift(SPLINE_12, 2.0**-30, 0),
        "antipodal close spline closed tie",
        "9.31322574615478515625e-10",
        "9.31322574615478515625e-10",
        "where the normal is the shift, the distance is its length 2^-30; nowhere can it be more",
    )
    add(
        "shifted_circle",
        UNIT,
        shift(UNIT, 3 * 2.0**-32, 4 * 2.0**-32),
        "antipodal close rational closed tie",
        "1.16415321826934814453125e-9",
        "1.16415321826934814453125e-9",
        "the shift has the length 5 * 2^-32",
    )
    add(
        "grown_circle",
        circle((0, 0), 1 + 2.0**-40),
        UNIT,
        "antipodal close flat rational closed",
        "9.094947017729282379150390625e-13",
        "9.094947017729282379150390625e-13",
        "radii differ by 2^-40",
    )


def pairs_with_digits():
    add(
        "quarter_circle_cubic",
        bezier((1, 0), (1, 0.551915024493510570743562722793), (0.551915024493510570743562722793, 1), (0, 1)),
        part(UNIT, slice(0, 1)),
        "antipodal close rational near_tie",
        source="best cubic with fixed ends: its deviations at 1/2 and at 0.21, 0.79 differ by 2e-17, the latter larger",
    )
    add(
        "quarter_circle_kappa",
        bezier((1, 0), (1, 0.5522847498), (0.5522847498, 1), (0, 1)),
        part(UNIT, slice(0, 1)),
        "antipodal close rational tie",
    )
    add(
        "twisted_cubic",
        bezier((0, 0, 0), (1 / 4, 0, 0), (1 / 2, 1 / 4, 0), (3 / 4, 3 / 4, 3 / 4)),
        bezier((0, 0, 0), (3 / 4, 3 / 4, 3 / 4)),
        "antipodal space",
    )
    add("wave_over_line", WAVE, bezier((0, 0), (4, 1)), "antipodal smooth")
    add("line_under_wave", bezier((0, 0), (4, 1)), WAVE, "one_to_two foot_and_foot smooth line")
    add("arch_and_wave", ARCH, WAVE, "one_to_two foot_and_end smooth")
    add("wave_and_arch", WAVE, ARCH, "one_to_two foot_and_foot smooth")
    add("loop_and_line", LOOP, bezier((0, 0), (4, 0)), "antipodal loop tie")
    add("line_and_loop", bezier((-1, 1), (5, 1.5)), LOOP, "a_end loop line")
    add("loop_and_cusp", LOOP, scale(CUSP, 4), "one_to_two foot_and_foot loop cusp tie")
    add("cusp_and_loop", scale(CUSP, 4), LOOP, "one_to_two foot_and_foot loop cusp tie")
    add("segment_inside_loop", bezier((1, 1.25), (3, 2.25)), LOOP, "a_end loop line")
    add(
        "evolute_of_parabola",
        bezier((0, 0.25), (0, 0.5)),
        PARABOLA,
        "a_end center",
        "0.5",
        None,
        "the center of curvature of the vertex, a triple root, is the end (0, 1/2)",
    )
    add(
        "along_evolute",
        bezier((-0.25, 0.5), (0.25, 0.5)),
        PARABOLA,
        "center",
        "0.5",
        None,
        "through the center of curvature of the vertex, a triple root",
    )
    add("across_evolute", bezier((0, 0), (0.125, 1)), PARABOLA, "a_end center")
    add("line_along_axis", bezier((-1, 1.5), (1.25, 1.625)), PARABOLA, "one_to_two foot_and_foot line")
    add(
        "wide_valley",
        bezier((-3, 1), (4, 1.5)),
        together(graph(0, 0, 0.25, start=-4, stop=4), graph(4, 0, -0.25, start=-4, stop=4)),
        "antipodal contours",
    )
    add("between_two_arches", bezier((0, 1.5), (2, 2.5), (4, 1.5)), together(ARCH, shift(ARCH, 0, 2)), "a_end contours")
    add(
        "between_two_circles",
        bezier((-2, -1), (0, 3), (2.5, -1.5)),
        together(circle((-3, 0), 1), circle((3, 0.5), 1)),
        "one_to_two foot_and_foot contours rational",
    )
    add(
        "foot_and_end_1",
        bezier((-1, 0.25), (0.5, 2.75)),
        together(bezier((-5, 0), (5, 0.5)), bezier((0.25, 3), (0.5, 6))),
        "one_to_two foot_and_end contours",
    )
    add(
        "foot_and_end_2",
        bezier((-1, 0.5), (1, 3.5)),
        together(bezier((-4, 0), (0, 0.5), (4, 0)), bezier((1, 4), (2, 5), (4, 3.5))),
        "one_to_two foot_and_end contours",
    )
    add(
        "foot_and_end_3",
        bezier((0, 0, 0), (1, 1, 3)),
        together(bezier((-2, 0, 0), (2, 0.5, 0)), bezier((1, 1, 3), (2, 3, 4))),
        "one_to_two foot_and_end contours space",
    )
    add(
        "foot_and_end_of_hook",
        bezier((2, 0.25), (2.125, 1.75)),
        bezier((0, 0), (8, -1), (6, 4), (2, 2)),
        "one_to_two foot_and_end",
    )
    add("end_and_end_1", bezier((-0.75, 1), (1.25, 0.75)), bezier((-1, 0), (0, -4), (1.5, 0)), "one_to_two end_and_end")
    add(
        "end_and_end_2",
        ARCH,
        together(bezier((0, 0), (0.5, 0.25)), bezier((3.5, 0.5), (4, 0))),
        "one_to_two end_and_end contours",
    )
    add(
        "end_and_end_of_horseshoe",
        bezier((-1, 4), (0, 3.5), (1.5, 3.5)),
        bezier((-1, 3), (-3, -3), (4, -3), (1.5, 2.5)),
        "one_to_two end_and_end",
    )
    add(
        "end_and_end_in_space",
        bezier((0, 0, 0), (4, 1, 2)),
        point_set((0, 1, 0), (4, 0, 3), (1, 5, 5)),
        "one_to_two end_and_end degree_0 space",
    )
    add("b_end_of_ray", bezier((0, 1.5), (-6, 0), (0, -1)), bezier((1, 0), (4, 1)), "b_end")
    add("b_end_of_arch", ellipse((-0.5, 0.25), 3, 2), scale(ARCH, 0.125), "b_end rational closed")
    add(
        "b_end_in_space",
        bezier((0, 3, 1), (-5, 0, 2), (0, -3, 0)),
        bezier((1, 0, 0), (4, 1, 1), (5, 0, 0)),
        "b_end space",
    )
    add("b_end_at_corner", bezier((-3, 1), (0, 6), (3, 1.5)), polyline((-4, -2), (0, 1), (4, -2)), "b_end polyline")
    add(
        "b_end_at_cusp_joint",
        bezier((-2, 2), (0, 7), (2, 1)),
        Shape(np.array([[(-4, 0), (-1, 0), (0, 2)], [(0, 2), (1, 0), (4, 0)]], float)),
        "b_end",
    )
    add("a_end_of_wave", WAVE, bezier((0, 0), (1, 1), (2, 0)), "a_end smooth")
    add(
        "a_end_in_space",
        bezier((0, 0, 0), (1, 2, 1), (5, 5, 5)),
        bezier((0, 0, 0), (2, 0, 0), (2, 2, 1), (0, 2, 3)),
        "a_end space",
    )
    add("a_end_of_rational", bezier((0, 0), (2, 3), (6, 5), weights=(1, 3, 0.5)), ARCH, "a_end rational")
    add(
        "corner_of_cubics",
        Shape(np.array([[(0, 0), (1, 0), (2, 1), (2, 4)], [(2, 4), (2, 1), (3, 0), (5, 0)]], float)),
        bezier((0, 0), (2.5, -1), (5, 0)),
        "corner cusp",
    )
    add("corner_of_polyline", polyline((0, 0), (3, 1), (4, 4), (6, -1)), WAVE, "corner polyline")
    add(
        "corner_in_space",
        polyline((0, 0, 0), (1, 2, 3), (4, 0, 0)),
        bezier((0, 0, 0), (2, -1, 0), (4, 0, 0)),
        "corner polyline space",
    )
    add("corner_inside_circle", polyline((1, 0), (0.25, 0.125), (0, 1)), UNIT, "corner polyline rational")
    add(
        "star_in_ellipse",
        polyline((3, 0), (0.5, 0.5), (0, 2), (-0.5, 0.375), (-2, -0.5), closed=True),
        ellipse((0, 0), 4, 2),
        "one_to_two foot_and_foot polyline rational closed",
    )
    add("ellipse_and_offset", ellipse((0, 0), 4, 2), ellipse((0.25, 0.125), 5, 3), "antipodal rational closed")
    add("ellipses_crossed", ellipse((0, 0), 3, 1), ellipse((0.125, 0.0625), 1, 3), "antipodal rational closed")
    add(
        "light_and_heavy_weights",
        bezier((0, 0), (2, 6), (4, 0), weights=(1, 1e-3, 1)),
        bezier((0, 0), (2, 6), (4, 0), weights=(1, 1e3, 1)),
        "one_to_two foot_and_foot rational weights",
    )
    add(
        "heavy_and_light_weights",
        bezier((0, 0), (2, 6), (4, 0), weights=(1, 1e3, 1)),
        bezier((0, 0), (2, 6), (4, 0), weights=(1, 1e-3, 1)),
        "antipodal rational weights",
    )
    add(
        "weights_in_the_thousands",
        bezier((0, 0), (1, 4), (3, -4), (4, 0), weights=(1e3, 1, 1e-3, 1)),
        bezier((0, 1), (1, -2), (3, 3), (4, -1), weights=(1e-3, 1e3, 1, 1e3)),
        "one_to_two foot_and_foot rational weights",
    )
    add(
        "rational_against_polynomial",
        bezier((0, 0), (1, 4), (3, -4), (4, 0), weights=(1, 4, 2, 1)),
        WAVE,
        "antipodal rational",
    )
    add(
        "rational_space_curves",
        random_bezier(11, 3, dim=3, weight_exponent=1),
        random_bezier(12, 4, dim=3, weight_exponent=0.5),
        "a_end rational space",
    )
    add("degrees_1_and_10", random_bezier(101, 1), random_bezier(210, 10), "a_end random")
    add("degrees_2_and_5", random_bezier(102, 2), random_bezier(205, 5), "a_end random")
    add("degrees_3_and_3", random_bezier(103, 3), random_bezier(203, 3), "a_end random")
    add("degrees_4_and_7", random_bezier(104, 4), random_bezier(207, 7), "a_end random")
    add("degrees_5_and_2", random_bezier(105, 5), random_bezier(202, 2), "antipodal random")
    add("degrees_6_and_6", random_bezier(106, 6), random_bezier(206, 6), "antipodal random")
    add("degrees_7_and_4", random_bezier(107, 7), random_bezier(204, 4), "a_end random")
    add("degrees_8_and_1", random_bezier(108, 8), random_bezier(201, 1), "b_end random")
    add("degrees_9_and_3", random_bezier(109, 9), random_bezier(203, 3), "a_end random")
    add("degrees_10_and_10", random_bezier(110, 10), random_bezier(210, 10), "a_end random")
    add(
        "degrees_0_and_9",
        Shape(random_bezier(31, 5).control_points.reshape(6, 1, 2)),
        random_bezier(32, 9),
        "a_end degree_0 random",
    )
    add(
        "degrees_9_and_0",
        random_bezier(32, 9),
        Shape(random_bezier(31, 5).control_points.reshape(6, 1, 2)),
        "a_end degree_0 random",
    )
    add("space_cubics", random_bezier(41, 3, dim=3), random_bezier(42, 3, dim=3), "a_end space random")
    add(
        "space_cubic_chains",
        random_bezier(43, 3, dim=3, segments=4),
        random_bezier(44, 3, dim=3, segments=3),
        "corner space random",
    )
    add("cubic_chains", random_bezier(45, 3, segments=5), random_bezier(46, 3, segments=4), "a_end random")
    add("degree_10_in_space", random_bezier(47, 10, dim=3), random_bezier(48, 8, dim=3), "antipodal space random")
    add("splines_12", SPLINE_12, SPLINE_12_B, "antipodal spline closed")
    add("splines_30", SPLINE_30, SPLINE_30_B, "antipodal spline closed")
    add("splines_90", SPLINE_90, SPLINE_90_B, "one_to_two foot_and_foot spline closed")
    add(
        "curve_and_spline_90",
        bezier((-1.25, 0), (0, 2), (0.25, -2), (1, 0.5)),
        SPLINE_90,
        "one_to_two foot_and_foot spline",
    )
    add(
        "splines_12_far_million",
        shift(SPLINE_12, 2.0**20, 2.0**20),
        shift(SPLINE_12_B, 2.0**20, 2.0**20),
        "antipodal spline closed far",
    )
    add(
        "arch_and_wave_far_million",
        shift(scale(ARCH, 2.0**-10), 1e6, -1e6),
        shift(scale(WAVE, 2.0**-10), 1e6, -1e6),
        "one_to_two foot_and_end far",
    )
    add(
        "parabola_far_hundred_million",
        shift(bezier((-0.5, 2), (0.5, 2)), 1e8, 1e8),
        shift(PARABOLA, 1e8, 1e8),
        "one_to_two foot_and_foot far",
        "1.32287565553229529525080787682",
        "2.5",
        "a shift of segment_over_parabola",
    )
    add(
        "loop_far_hundred_million",
        shift(LOOP, -1e8, 3e8),
        shift(scale(CUSP, 4), -1e8, 3e8),
        "one_to_two foot_and_foot loop cusp far",
    )
    add(
        "circles_far",
        shift(UNIT, 1e8, 0),
        shift(circle((0.5, 0), 3), 1e8, 0),
        "antipodal rational far closed",
        "2.5",
        "2.5",
    )
    add("arch_and_wave_small", scale(ARCH, 2.0**-40), scale(WAVE, 2.0**-40), "one_to_two foot_and_end scale smooth")
    add("arch_and_wave_large", scale(ARCH, 2.0**40), scale(WAVE, 2.0**40), "one_to_two foot_and_end scale smooth")
    add(
        "circle_in_ellipse_small",
        scale(UNIT, 2.0**-40),
        scale(ellipse((0, 0), 2, 1), 2.0**-40),
        "one_to_two foot_and_foot tie rational closed scale",
    )
    add(
        "circle_in_ellipse_large",
        scale(UNIT, 2.0**40),
        scale(ellipse((0, 0), 2, 1), 2.0**40),
        "one_to_two foot_and_foot tie rational closed scale",
    )
    add(
        "parabola_and_shifted",
        PARABOLA,
        shift(PARABOLA, 2.0**-30, 0),
        "a_end close smooth",
        "9.31322574615478515625e-10",
        "9.31322574615478515625e-10",
        "2^-30: the end of the other curve is the foot of an end",
    )
    add(
        "figure_eight",
        Shape(np.array([[(0, 0), (3, 3), (3, -3), (0, 0)], [(0, 0), (-3, 3), (-3, -3), (0, 0)]], float)),
        scale(UNIT, 1.5),
        "loop closed rational center",
        "1.5",
        None,
        "3/2 - |p| where a meets the center",
    )
    add(
        "circle_and_figure_eight",
        scale(UNIT, 1.5),
        Shape(np.array([[(0, 0), (3, 3), (3, -3), (0, 0)], [(0, 0), (-3, 3), (-3, -3), (0, 0)]], float)),
        "one_to_two foot_and_foot loop closed rational",
        None,
        "1.5",
    )


closed_forms()
coincidences()
pairs_with_digits()
CASES = tuple(TABLE)
names = tuple(case.name for case in CASES)


def by_tag(tag):
    """The cases with this tag, in the order of the table."""
    return tuple(case for case in CASES if tag in case.tags)
