"""Four panels of the two-step method on two closed curves; numbers by the experiment of the same name.

Caption: Example 2 and figure 5 of Cao et al. 2014 with our own data: two closed splines of 90 control points, the
samples of A, the candidates of the three largest samples, and the result. Both directed distances agree with a
reference to 1e-10 mm. Sampling with up to 400 samples a segment has errors above 1e-8 and 1e-5 mm.
"""

from common import Picture
from common_cao14 import four_panels


def main() -> None:
    """Loads and draws."""
    picture = Picture(__file__, __doc__)
    picture.save(four_panels(picture.numbers, bar=(0.5, 0.52)))


if __name__ == "__main__":
    main()
