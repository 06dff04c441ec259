"""Four panels of the two-step method on an open and a closed curve; numbers by the experiment of the same name.

Caption: Example 1 and figure 4 of Cao et al. 2014 with our own data: the distances from eleven samples of A to B, the
stationary points of one sample, the candidates that the largest samples lead to, and the result. An antipodal and a
one-to-two maximum are found, each to 1e-10 mm.
"""

from common import Picture
from common_cao14 import four_panels


def main() -> None:
    """Loads and draws."""
    picture = Picture(__file__, __doc__)
    picture.save(four_panels(picture.numbers, bar=(0.12, 0.1)))


if __name__ == "__main__":
    main()
