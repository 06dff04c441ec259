"""Four panels of the two-step method on two closed curves; numbers by the experiment of the same name."""

from common import Picture
from common_cao14 import four_panels


def main() -> None:
    """Loads and draws."""
    picture = Picture(__file__, __doc__)
    picture.save(four_panels(picture.numbers, bar=(0.5, 0.52)))


if __name__ == "__main__":
    main()
