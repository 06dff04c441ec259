"""Four panels of the two-step method on two closed curves; numbers by cao14_closed_closed's experiment.

Caption: Example 2 and figure 5 of Cao et al. 2014 with our own data: two closed splines of 90 control points, the
samples of A, the three largest samples above both neighbors, and the maxima between these neighbors. Both directed
distances agree with a reference to 1e-10 mm. Up to 400 samples a segment leave errors above 1e-7 mm in h(A, B) and
above 1e-4 mm in h(B, A).

Alt text: Four drawings of two wavy closed curves, one blue and one dashed orange: 90 samples with their feet, ten
segments from one sample to its stationary points, three candidate samples, and the three maxima found.
"""

from common import Picture
from common_cao14 import four_panels


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(four_panels(picture.numbers, bar=(0.5, 0.52)))


if __name__ == "__main__":
    main()
