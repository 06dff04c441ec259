"""The checker of certificates, in exact integer arithmetic and of the standard library alone.

A certificate claims lower <= h <= upper for two shapes, where h is the largest distance of a point of a to b
("directed"), or the larger of that and of its counterpart from b to a ("two_sided"), or the smallest distance of a
point of a and a point of b ("minimum"). Every number of it is a float, hence a rational m / 2^k, and nothing here
rounds.

Points, curves, meshes and parametric surfaces are one form: pieces, which are polynomials (over a weight) on a point,
an interval, a triangle or a square, in Bernstein form. Of a polynomial surface the pieces are six tetrahedra, its box,
and it is the places where its polynomial is zero: what is said of it is proven with multipliers of the polynomial, and
a point of it by a change of sign (`zeros`, `surface_proofs`).

- The **upper bound** is proven by cells: simplices in the domains of the pieces of a, which cover them by construction
  (`cells`). Each names one or more feet, a piece of b with a map of the cell into its domain, and a bound. For every
  place u of the cell one of the feet is at most `bound` away; of several, because a combination of
  bound^2 - |a(u) - b(phi_k(u))|^2 with multipliers that are not negative is not negative (`proofs`).
- The **lower bound** is proven by a witness, a point of a: |P - b(v)|^2 - lower^2 >= 0 over all pieces of b.
- A **minimum** is proven by a point of each shape, and by pairs of parts with a plane between them (`apart`).

A polynomial is proven to be non-negative on a simplex when its Bernstein coefficients are, if need be on halves of
halves (`polynomials`).

Nothing of the search, and nothing of the rest of this package, is used: this folder can be read, copied and run by
itself, `python verification FILE...`: a line for each certificate that is proven, exit status 1 where one is refused, 2
where one cannot be read.

Source: the hull property is in Farouki & Rajan, CAGD 5 (1988).
"""

from jhd.distance.certificate.verification.proofs import Proven as Proven
from jhd.distance.certificate.verification.proofs import sentence as sentence
from jhd.distance.certificate.verification.proofs import verify as verify
from jhd.distance.certificate.verification.reading import opened as opened
from jhd.distance.certificate.verification.reading import parsed as parsed
from jhd.distance.certificate.verification.structure import FORMAT as FORMAT
from jhd.distance.certificate.verification.structure import KINDS as KINDS
from jhd.distance.certificate.verification.structure import VERSION as VERSION
from jhd.distance.certificate.verification.structure import CertificateError as CertificateError
from jhd.distance.certificate.verification.structure import digest as digest
