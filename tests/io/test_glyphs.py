"""Outlines against matplotlib's own reading of the fonts, and by hand where the format leaves something implicit."""

import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.t2CharStringPen import T2CharStringPen
from fontTools.ttLib import TTFont
from matplotlib.ft2font import FT2Font, LoadFlags

from jhd._io.errors import ParseError
from jhd._io.glyphs import _font_file, load_glyph, parse_font_spec


def reference_points(font, letter, units):
    """End points and control points of all segments of the outline as matplotlib's FreeType reads it, in font units."""
    reader = FT2Font(_font_file(font))
    reader.set_size(units, 72)
    reader.load_char(ord(letter), flags=LoadFlags.NO_HINTING)
    vertices, codes = reader.get_path()
    # CLOSEPOLY rows carry no point of the outline.
    return vertices[codes != 79]


@pytest.mark.parametrize("font", ["DejaVu Sans", "DejaVu Serif", "STIXGeneral", "cmr10"])
@pytest.mark.parametrize("letter", ["a", "B", "8"])
def test_an_outline_has_the_points_of_matplotlibs(font, letter):
    with TTFont(_font_file(font)) as opened:
        units = opened["head"].unitsPerEm  # pyright: ignore[reportAttributeAccessIssue]
    points = np.asarray(load_glyph(font, letter).control_points)
    theirs = reference_points(font, letter, units)
    # FreeType rounds implied points to 1/64 unit, which halves are multiples of: the sets agree exactly. Lines raised
    # to quadratics have control points that only we have.
    straight = np.all(2 * points[:, 1] == points[:, 0] + points[:, -1], axis=-1)
    ours = np.concatenate([points[:, 0], points[~straight, 1]])
    assert points.shape[1] == 3
    assert {tuple(p) for p in ours.tolist()} == {tuple(p) for p in theirs.tolist()}


def test_a_line_raised_to_a_quadratic_has_its_midpoint_exactly():
    points = np.asarray(load_glyph("DejaVu Sans", "B").control_points)
    np.testing.assert_array_equal(points[0], [[403, 713], [403, 439.5], [403, 166]])


@pytest.mark.parametrize(("letter", "contours"), [("l", 1), ("a", 2), ("B", 3), ("i", 2), ("é", 3)])
def test_every_contour_closes_on_its_own_start(letter, contours):
    curve = load_glyph("DejaVu Sans", letter)
    next_segment = np.asarray(curve.next_segment)
    points = np.asarray(curve.control_points)
    assert sorted(next_segment) == list(range(curve.count))
    assert np.sum(next_segment <= np.arange(curve.count)) == contours
    np.testing.assert_array_equal(points[next_segment, 0], points[:, -1])


def test_a_composite_glyph_contains_its_base_letter():
    with_accent, plain = (np.asarray(load_glyph("DejaVu Sans", letter).control_points) for letter in "ée")
    assert any(np.array_equal(with_accent[k : k + len(plain)], plain) for k in range(len(with_accent)))


def test_the_size_scales_the_em():
    units, scaled = load_glyph("DejaVu Sans", "g"), load_glyph("DejaVu Sans", "g", size=1.0)
    np.testing.assert_array_equal(np.asarray(scaled.control_points) * 2048, np.asarray(units.control_points))


def test_letters_of_a_text_follow_each_other_by_their_advances():
    word, letters = load_glyph("DejaVu Sans", "o n"), [load_glyph("DejaVu Sans", letter) for letter in "on"]
    with TTFont(_font_file("DejaVu Sans")) as font:
        names = font.getBestCmap() or {}
        shift = sum(font["hmtx"][names[ord(letter)]][0] for letter in "o ")
    expected = np.concatenate([letters[0].control_points, np.asarray(letters[1].control_points) + [shift, 0]])
    np.testing.assert_array_equal(word.control_points, expected)


def test_a_regular_face_is_preferred_and_files_can_be_named():
    assert _font_file("DejaVu Sans").endswith("DejaVuSans.ttf")
    assert "mpl-data" in _font_file("dejavu sans")
    bold = load_glyph("DejaVuSans-Bold", "l")
    assert float(np.ptp(bold.control_points[..., 0])) > float(
        np.ptp(load_glyph("DejaVu Sans", "l").control_points[..., 0])
    )
    path = _font_file("DejaVuSans-Bold")
    np.testing.assert_array_equal(load_glyph(path, "l").control_points, bold.control_points)


def truetype_without_on_curve_points(file):
    """A font whose letter O has four off-curve points only, and whose letter P is left without any point."""
    from fontTools.pens.ttGlyphPen import TTGlyphPen

    pen = TTGlyphPen(None)
    pen.qCurveTo((0, 0), (100, 0), (100, 100), (0, 100), None)  # pyright: ignore[reportArgumentType]
    pen.closePath()
    builder = FontBuilder(200, isTTF=True)
    builder.setupGlyphOrder([".notdef", "O", "P"])
    builder.setupCharacterMap({ord("O"): "O", ord("P"): "P"})
    empty = TTGlyphPen(None).glyph()
    builder.setupGlyf({".notdef": empty, "O": pen.glyph(), "P": empty})
    finish(builder, file)


def cff_square_with_a_round_corner(file):
    pen = T2CharStringPen(200, None)
    pen.moveTo((0, 0))
    pen.lineTo((90, 0))
    pen.curveTo((96, 0), (102, 6), (102, 12))
    pen.closePath()
    builder = FontBuilder(200, isTTF=False)
    builder.setupGlyphOrder([".notdef", "D"])
    builder.setupCharacterMap({ord("D"): "D"})
    charstring = pen.getCharString()
    builder.setupCFF("Square", {}, {".notdef": T2CharStringPen(200, None).getCharString(), "D": charstring}, {})
    finish(builder, file)


def finish(builder, file):
    names = builder.font.getGlyphOrder()
    builder.setupHorizontalMetrics({name: (200, 0) for name in names})
    builder.setupHorizontalHeader(ascent=160, descent=-40)
    builder.setupNameTable({"familyName": "Square", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(file)


def test_on_curve_points_that_truetype_implies_are_the_midpoints(tmp_path):
    file = tmp_path / "round.ttf"
    truetype_without_on_curve_points(file)
    curve = load_glyph(file, "O")
    starts = {tuple(point) for point in np.asarray(curve.control_points)[:, 0].tolist()}
    assert curve.count == 4
    assert starts == {(50.0, 0.0), (100.0, 50.0), (50.0, 100.0), (0.0, 50.0)}
    assert sorted(np.asarray(curve.next_segment).tolist()) == [0, 1, 2, 3]


def test_cubics_of_cff_fonts_stay_cubics_and_the_closing_line_is_added(tmp_path):
    file = tmp_path / "square.otf"
    cff_square_with_a_round_corner(file)
    curve = load_glyph(file, "D")
    assert (curve.degree, curve.count) == (3, 3)
    np.testing.assert_allclose(curve.control_points[0], [[0, 0], [30, 0], [60, 0], [90, 0]], rtol=1e-15)
    np.testing.assert_array_equal(curve.control_points[1], [[90, 0], [96, 0], [102, 6], [102, 12]])
    np.testing.assert_array_equal(np.asarray(curve.control_points)[2, [0, 3]], [[102, 12], [0, 0]])
    assert curve.next_segment.tolist() == [1, 2, 0]


def test_specs_are_split_at_the_last_colon():
    assert parse_font_spec("font:DejaVu Sans:a") == ("DejaVu Sans", "a")
    assert parse_font_spec("font:C:/fonts/x.ttf:ab") == ("C:/fonts/x.ttf", "ab")
    assert parse_font_spec("font:DejaVu Sans::") == ("DejaVu Sans", ":")


@pytest.mark.parametrize("spec", ["font:a", "font::", "font:DejaVu Sans:", "DejaVu Sans:a", "font::a"])
def test_other_specs_are_refused(spec):
    with pytest.raises(ParseError, match="needs font:NAME:LETTER"):
        parse_font_spec(spec)


def test_an_unknown_font_is_refused_with_names_of_known_ones():
    with pytest.raises(
        ValueError, match="'Helvetika' is not a font known to matplotlib; known are for example .*DejaVu Sans"
    ):
        load_glyph("Helvetika", "a")


def test_a_letter_without_glyph_is_refused_with_its_code_point():
    with pytest.raises(ValueError, match=r"DejaVu Sans has no glyph for '漢' \(U\+6F22\)"):
        load_glyph("DejaVu Sans", "漢")


@pytest.mark.parametrize("text", [" ", "  "])
def test_a_text_without_outline_is_refused(text):
    with pytest.raises(ValueError, match=f"'{text}' has no outline in DejaVu Sans"):
        load_glyph("DejaVu Sans", text)


def test_bad_texts_sizes_and_files_are_refused(tmp_path, as_a_user):
    with pytest.raises(ValueError, match="text is empty"):
        load_glyph("DejaVu Sans", "")
    with pytest.raises(TypeError, match="text is 3; needs a string"):
        load_glyph("DejaVu Sans", 3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="size is 'x'; needs a positive length"):
        load_glyph("DejaVu Sans", "a", size="x")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="size is -1.0; needs a positive length"):
        load_glyph("DejaVu Sans", "a", size=-1.0)
    with pytest.raises(FileNotFoundError, match=r"nothing\.ttf: no such file"):
        load_glyph(tmp_path / "nothing.ttf", "a")
    broken = tmp_path / "broken.ttf"
    broken.write_bytes(b"no font at all")
    with pytest.raises(ParseError, match="broken.ttf: is not a readable font"):
        load_glyph(broken, "a")
