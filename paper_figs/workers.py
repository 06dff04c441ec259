"""Pairs per second and CPU time per pair against the number of workers; numbers by workers' experiment.

The horizontal line is a plain loop of calls.

Caption: Pairs per second and CPU time per pair against the number of workers: threads, processes, Dask and simulated
devices; the horizontal line is a plain loop of calls. Results are bitwise identical for all kinds and numbers of
workers, at less than a third of the CPU time of the loop.

Alt text: Two line plots against one to eight workers. Pairs per second rise from one to two workers and then level off;
the CPU time of a pair stays level, far below the line of the plain loop.
"""

from typing import Any

from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, letter, style
from matplotlib.figure import Figure

_LOOKS: dict[str, dict[str, Any]] = {
    "threads": {"color": BLUE, "marker": "o", "linestyle": "-"},
    "processes": {"color": VERMILLION, "marker": "s", "linestyle": (0, (4, 1.2))},
    "loky": {"color": PURPLE, "marker": "v", "linestyle": (0, (1, 1))},
    "Dask": {"color": GREEN, "marker": "^", "linestyle": (0, (6, 1.2, 1, 1.2))},
    "devices": {"color": ORANGE, "marker": "D", "linestyle": (0, (2, 1))},
}
_NAMES = {"devices": "simulated devices", "Dask": "Dask's workers"}
_MARK: dict[str, Any] = {"markersize": 4.0, "markeredgecolor": BLACK, "markeredgewidth": 0.4}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 68 * MM), layout="constrained")
        rate, cpu = figure.subplots(1, 2, sharex=True)
        for kind, looks in _LOOKS.items():
            entries = [entry for entry in numbers["entries"] if entry["kind"] == kind]
            count = [entry["workers"] for entry in entries]
            if count:
                label = _NAMES.get(kind, kind)
                rate.plot(count, [entry["rate"] for entry in entries], label=label, **looks, **_MARK)
                cpu.plot(count, [entry["cpu_a_pair"] for entry in entries], **looks, **_MARK)
        (plain,) = (entry for entry in numbers["entries"] if entry["kind"] == "plain loop")
        for ax, value in ((rate, plain["rate"]), (cpu, plain["cpu_a_pair"])):
            ax.axhline(value, color=GRAY, linewidth=1.4, label="plain loop of calls")
            counts = sorted({entry["workers"] for entry in numbers["entries"]})
            ax.set_xscale("log", base=2)
            ax.set_xticks(counts, [f"{count}" for count in counts])
            ax.set_xlabel("workers")
            ax.set_ylim(bottom=0)
            ax.minorticks_off()
        rate.set_ylabel("pairs per second")
        cpu.set_ylabel("CPU time per pair (s)")
        letter(rate, "a", f"{numbers['pairs']} pairs, {numbers['processors']} processors")
        letter(cpu, "b", "cost")
        handles, labels = rate.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=6, handlelength=2.4, columnspacing=1.2)
    return figure


if __name__ == "__main__":
    main()
