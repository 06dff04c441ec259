"""The defects of all folders, in one list."""

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
