"""Four panels of the two-step method on an open and a closed curve; numbers by cao14_open_closed's experiment.

Caption: Example 1 and figure 4 of Cao et al. 2014 with our own data: eleven samples of A and their feet on B, the
stationary points of one sample, the two samples above both neighbors, and the maxima between these neighbors, one
antipodal and one one-to-two. The larger one is h(A, B). Both directed distances agree with a reference to 1e-10 mm.

Alt text: Four drawings of a blue open curve inside a dashed orange closed curve: sample points with thin segments to
their feet, segments from one sample to eight stationary points, two candidate samples, and the two maxima found.
"""

from common import Picture
from common_cao14 import four_panels


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(four_panels(picture.numbers, bar=(0.12, 0.1)))


if __name__ == "__main__":
    main()
