"""A pair that loses its maximum when both curves are trimmed, and the frequency of this loss.

Numbers by two_sided_trimming's experiment.

Caption: A pair that loses its maximum when both curves are trimmed as published, since its foot point is trimmed away,
and the frequency of this loss. Of 150 pairs that differ in two bumps, 111 lose the maximum, by up to 99 % of the
distance. No maximum is lost if only one curve is trimmed.

Alt text: Four panels: two nearly equal curves with a bump in one of them, kept parts bold; two profiles of the
distance along each curve; and sorted ratios of the trimmed value to the distance for three kinds of pairs.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, freeze, letter, place_label, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import jhd

_CURVES = {"a": (BLUE, "$A$"), "b": (ORANGE, "$B$")}
_FAMILIES: dict[str, dict[str, Any]] = {
    "bumps": {"color": VERMILLION, "marker": "o", "label": "bumps"},
    "noise": {"color": GREEN, "marker": "s", "label": "noise"},
    "unrelated": {"color": PURPLE, "marker": "^", "label": "unrelated"},
}
_MARK: dict[str, Any] = {"markersize": 3.4, "markeredgecolor": BLACK, "markeredgewidth": 0.4}
# A ring about the maximum, so that the short part of the curve that remains there is seen; feet are dots.
_PLACE: dict[str, Any] = {
    "marker": "o",
    "markersize": 8,
    "markerfacecolor": "none",
    "markeredgecolor": BLACK,
    "zorder": 6,
}
_FOOT: dict[str, Any] = {"marker": "o", "markersize": 4, "color": "white", "markeredgecolor": BLACK, "zorder": 6}
_BOUND = "map"


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    example = numbers["example"]
    with style():
        figure = Figure(figsize=(175 * MM, 104 * MM), layout="constrained")
        axes = figure.subplot_mosaic(
            [["pair", "pair", "losses"], ["a", "b", "losses"]], width_ratios=[1.0, 1.0, 1.15], height_ratios=[1.3, 1.0]
        )
        _draw_pair(axes["pair"], example)
        letter(axes["pair"], "a", "a foot is trimmed, and with it the maximum")
        for k, name in enumerate("ab"):
            _draw_profile(axes[name], example, k)
        letter(axes["a"], "b", "distance to $B$ along $A$")
        letter(axes["b"], "c", "distance to $A$ along $B$")
        _draw_losses(axes["losses"], numbers)
        letter(axes["losses"], "d", "value with both curves trimmed")
        freeze(figure)
        _draw_labels(axes["pair"], example)
    return figure


def _segments(trial: dict[str, Any], name: str) -> jhd.BezierSegments:
    return jhd.BezierSegments(np.array(trial[name]))


def _draw_pair(ax: Axes, trial: dict[str, Any]) -> None:
    """Draw both curves (trimmed parts dashed, kept parts bold), the true witness, and the point found."""
    for k, (name, (color, label)) in enumerate(_CURVES.items()):
        curve, left = _segments(trial, name), trial["bounds"][_BOUND]["left"][k]
        t = np.linspace(0, curve.count, 400)
        dashed = (0, (3, 1.2))
        ax.plot(*np.asarray(curve(t)).T, color=color, linewidth=1.0, linestyle=dashed, label=f"{label}, trimmed")
        for i, (segment, t0, t1) in enumerate(zip(left["segment"], left["t0"], left["t1"], strict=True)):
            part = np.asarray(curve.point(np.full(24, segment), np.linspace(t0, t1, 24)))
            ax.plot(
                *part.T, color=color, linewidth=3.2, solid_capstyle="butt", label=f"{label}, kept" if not i else None
            )
    for x, foot in zip(*_witness(trial), strict=True):
        ax.plot(*np.stack([x, foot]).T, color=BLACK, linewidth=1.0)
    point, feet = _witness(trial)
    ax.plot(*point[0], **_PLACE)
    ax.plot(*feet.T, linestyle="none", **_FOOT)
    wrong = _wrong(trial)
    ax.plot(*wrong.T, color=BLACK, linewidth=1.0, linestyle=(0, (1, 1)))
    ax.plot(*wrong[0], marker="X", color=VERMILLION, zorder=6, markersize=6, markeredgecolor=BLACK, markeredgewidth=0.4)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.06)
    ax.set_xlabel("$x$")
    ax.set_ylabel("$y$")


def _draw_profile(ax: Axes, trial: dict[str, Any], k: int) -> None:
    """Plot the distance along one curve, kept parts bold, LB, and the maximum or its feet."""
    profile, found = trial["profiles"][k], trial["bounds"][_BOUND]
    (color, _), left = _CURVES["ab"[k]], found["left"][k]
    t, distance = np.array(profile["t"]), np.array(profile["distance"])
    ax.plot(t, distance, color=color, linewidth=1.0, linestyle=(0, (3, 1.2)))
    for segment, t0, t1 in zip(left["segment"], left["t0"], left["t1"], strict=True):
        inner = np.linspace(segment + t0, segment + t1, 24)
        ax.plot(inner, np.interp(inner, t, distance), color=color, linewidth=3.6, solid_capstyle="butt")
    ax.axhline(found["lower"], color=GRAY, linewidth=0.7)
    ax.text(t[-1], found["lower"], "$LB$", ha="right", va="bottom", color=GRAY)
    witness = trial["solution"]["witness"]
    if ("a_to_b", "b_to_a")[k] == witness["direction"]:
        places, mark = np.array([witness["element"] + witness["t"]]), _PLACE
    else:
        places, mark = np.array(witness["feet_elements"]) + np.array(witness["feet_params"]), _FOOT
    ax.plot(places, np.interp(places, t, distance), linestyle="none", **mark)
    ax.set_xlim(t[0], t[-1])
    ax.set_ylim(0, 1.22 * found["lower"])
    ax.set_xlabel(("parameter $t$ on $A$", "parameter $s$ on $B$")[k])
    ax.set_ylabel("distance")


def _witness(trial: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return the maximum, once for each foot, and its feet."""
    witness = trial["solution"]["witness"]
    feet = np.array(witness["feet"])
    return np.broadcast_to(witness["point"], feet.shape), feet


def _wrong(trial: dict[str, Any]) -> np.ndarray:
    """Return the point that the method finds when both curves are trimmed, and its foot."""
    found = trial["bounds"][_BOUND]["both"]
    curve, other = (_segments(trial, name) for name in ("ab" if found["curve"] == "a" else "ba"))
    x = np.asarray(curve.point(found["segment"], found["t"]))
    return np.stack([x, np.asarray(jhd.project(x, other).foot)])


def _draw_labels(ax: Axes, trial: dict[str, Any]) -> None:
    exact, found = trial["solution"]["value"], trial["bounds"][_BOUND]
    ax.legend(loc="lower left", ncols=1, handlelength=2.2, labelspacing=0.3)
    point, feet = _witness(trial)
    place_label(ax, point[0], f"maximum: {exact:.4f}\n$LB$: {found['lower']:.4f}", distance=9.0)
    # One foot is stored twice.
    for foot, name in {tuple(foot): name for foot, name in zip(feet, _trimmed_feet(trial), strict=True)}.items():
        place_label(ax, foot, name)
    place_label(ax, _wrong(trial)[0], f"found: {found['both']['value']:.4f}")


def _trimmed_feet(trial: dict[str, Any]) -> list[str]:
    """Return a label for each foot: kept or trimmed."""
    witness = trial["solution"]["witness"]
    left = trial["bounds"][_BOUND]["left"][1 if witness["direction"] == "a_to_b" else 0]
    segment, t0, t1 = (np.array(left[key]) for key in ("segment", "t0", "t1"))
    places = zip(witness["feet_elements"], witness["feet_params"], strict=True)
    return ["foot, kept" if np.any((segment == k) & (t0 <= s) & (s <= t1)) else "foot, trimmed" for k, s in places]


def _draw_losses(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot the sorted ratios of values to distances for each kind of pair."""
    for family, line in _FAMILIES.items():
        trials = numbers["trials"][family]
        share = np.sort([x["bounds"][_BOUND]["both"]["value"] / x["solution"]["value"] for x in trials])
        rank = 100 * (np.arange(len(share)) + 0.5) / len(share)
        ax.plot(rank, share, linewidth=1.0, clip_on=False, markevery=max(1, len(share) // 15), **_MARK, **line)
    ax.axhline(1.0, color=GRAY, linewidth=0.7)
    ax.set_xlim(0, 100)
    ax.set_ylim(0, 1.04)
    ax.set_xlabel("pairs, in order of the value (%)")
    ax.set_ylabel("value / Hausdorff distance")
    ax.legend(loc="center", bbox_to_anchor=(0.47, 0.42), handlelength=2.0, labelspacing=0.3)


if __name__ == "__main__":
    main()
