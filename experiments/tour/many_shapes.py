# pyright: strict
"""Collections: the nearest of many shapes, and near-duplicates, from a fraction of all distances."""

import numpy as np

import jhd

rng = np.random.default_rng(2)
letters = [jhd.BezierSegments(rng.normal(size=(1 + k % 5, 3, 2)).cumsum(axis=0)) for k in range(40)]
copy = jhd.BezierSegments(np.asarray(letters[7].control_points) + 0.001)

near = jhd.nearest_shapes([copy], letters, k=2)
assert near.index[0, 0] == 7 and near.upper[0, 0] < 0.0015 and near.computed < 20
print(near)

same = jhd.pairs_within([*letters, copy], threshold=0.01)
assert same.index.tolist() == [[7, 40]] and len(same.undecided) == 0
print(same)

every = jhd.pairwise(letters[:6])
assert np.all(every.lower <= every.value) and np.all(every.value <= every.upper)
print(every)
