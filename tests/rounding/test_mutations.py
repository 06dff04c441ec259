"""No error term of a proven bound can be removed without a test that notices."""

import pytest

from tests.rounding import mutations


@pytest.mark.slow
def test_every_removed_term_is_noticed():
    assert mutations.run(mutations.MUTATIONS) == []


def test_every_term_is_in_the_package_once():
    for mutation in mutations.MUTATIONS:
        assert mutations.text_of(mutation).count(mutation.old) == 1, mutation
        assert mutation.new != mutation.old
