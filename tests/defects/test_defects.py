"""Each defect of the table is noticed by the test that it names, but for those that are listed as unnoticed."""

import pytest

from tests.defects import runner
from tests.defects.table import DEFECTS

FILES = sorted({defect.file for defect in DEFECTS})
# One of each kind, by file and new text: an error term, a bound of a search, the checker, a file from elsewhere.
FEW = {
    ("_arithmetic/balls.py", "x - 4"),
    ("_distance/search/curves.py", "closed=closed, dropped"),
    ("_distance/certificate/verification/proofs.py", "+ p.reach + q.reach"),
    ("_runtime/storage.py", "return body"),
}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    return runner.Copy(tmp_path_factory.mktemp("defects"))


@pytest.mark.slow
def test_a_defect_of_each_kind_is_noticed(copy):
    few = [defect for defect in DEFECTS if (defect.file, defect.new) in FEW]
    assert len(few) == len(FEW)
    assert runner.unnoticed(copy, few) == []


@pytest.mark.exhaustive
@pytest.mark.parametrize("file", FILES)
def test_every_defect_is_noticed(copy, file):
    assert runner.unnoticed(copy, [defect for defect in DEFECTS if defect.file == file]) == []


def test_every_defect_changes_the_package_in_one_place_and_names_a_test():
    assert [defect for defect in DEFECTS if runner.text_of(defect.file).count(defect.old) != 1] == []
    assert [defect for defect in DEFECTS if not runner.is_there(defect.test)] == []


def test_the_table_has_no_line_twice_and_none_without_a_change():
    assert len({defect[:3] for defect in DEFECTS}) == len(DEFECTS) >= 130
    assert all(defect.new != defect.old for defect in DEFECTS)
