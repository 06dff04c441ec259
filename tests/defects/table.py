"""The defects of all folders, in one list, and those of them that no test notices."""

from tests.defects import arithmetic, certificates, distance, fields, outer, searches, shapes

DEFECTS = [
    *arithmetic.DEFECTS,
    *shapes.DEFECTS,
    *fields.DEFECTS,
    *searches.DEFECTS,
    *certificates.DEFECTS,
    *distance.DEFECTS,
    *outer.DEFECTS,
]

# By file and new text: the tests named in these rows pass with the defect. Each is to get a test that fails, or to go
# if it changes no result.
UNNOTICED = {
    ("fields/adaptive_error.py", "np.max(boxes.values[:, None] + 0 * apart, axis=2) - low"),
    ("distance/witness/active.py", "balanced"),
    ("fitting/soft.py", "distance = _distances(of, b, long)"),
}
