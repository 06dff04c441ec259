"""The checker of certificates, in exact integer arithmetic, with the standard library alone.

A certificate claims lower <= h <= upper for two shapes. Here h is the largest distance from a point of a to b
("directed"), the larger of both directed distances ("two_sided"), or the smallest distance between a point of a and a
point of b ("minimum"). Every number in it is a float, hence a rational m / 2^k, and nothing here rounds.

Points, curves, meshes and parametric surfaces have one form: pieces, which are polynomials (over a weight) on a point,
an interval, a triangle or a square, in Bernstein form. The pieces of an implicit surface are six tetrahedra, its box;
the surface is the zero set of its polynomial. Statements about it are proven with multipliers of the polynomial, and
its points by a change of sign (`zeros`, `inequalities`).

- The **upper bound** is proven by cells: simplices in the domains of the pieces of a, which cover them by construction
  (`cells`). Each cell names one or more foot points (a piece of b with a map of the cell into its domain) and a bound.
  For every u in the cell, one of the foot points is at most `bound` away. For several foot points this holds because a
  combination of bound^2 - |a(u) - b(phi_k(u))|^2 with non-negative multipliers is not negative (`inequalities`).
- The **lower bound** is proven by a witness, a point of a: |P - b(v)|^2 - lower^2 >= 0 over all pieces of b.
- A **minimum** is proven by a point of each shape, and by pairs of parts with a plane between them (`apart`).

A polynomial is proven to be non-negative on a simplex if its Bernstein coefficients are, if necessary after repeated
halving (`polynomials`).

This folder uses nothing of the search and nothing of the rest of this package. It can be read, copied and run by
itself: `python verification FILE...` prints a line for each certificate that is proven. The exit status is 1 if a
certificate is refused, 2 if one cannot be read.

Source: the hull property is in Farouki & Rajan, CAGD 5 (1988).
"""

from jhd._distance.certificate.verification.proofs import Proven as Proven
from jhd._distance.certificate.verification.proofs import sentence as sentence
from jhd._distance.certificate.verification.proofs import verify as verify
from jhd._distance.certificate.verification.reading import opened as opened
from jhd._distance.certificate.verification.reading import parsed as parsed
from jhd._distance.certificate.verification.structure import FORMAT as FORMAT
from jhd._distance.certificate.verification.structure import KINDS as KINDS
from jhd._distance.certificate.verification.structure import VERSION as VERSION
from jhd._distance.certificate.verification.structure import CertificateError as CertificateError
from jhd._distance.certificate.verification.structure import digest as digest
from jhd._distance.certificate.verification.values import UncheckedCertificateError as UncheckedCertificateError
