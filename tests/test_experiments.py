"""Experiments and figures: each has its namesake, says what it is for, runs small, and what it claims holds.

And the scripts of the tour, which check themselves what they say.
"""

import argparse
import ast
import html
import json
import re
import runpy
import sys
from contextlib import chdir, contextmanager
from pathlib import Path

import numpy as np
import pytest

from experiments.claims import CLAIMS
from tests.processes import python

ROOT = Path(__file__).resolve().parent.parent
# Modules that experiments or figures share, and what draws all figures.
SHARED = "common", "all"


def scripts(folder):
    return sorted(p for p in (ROOT / folder).glob("*.py") if not p.stem.startswith(SHARED))


EXPERIMENTS, FIGURES, TOUR = scripts("experiments"), scripts("paper_figs"), scripts("experiments/tour")
PARAMETERS = runpy.run_path(str(ROOT / "experiments" / "common_parameters.py"))
GALLERY = runpy.run_path(str(ROOT / "paper_figs" / "common_gallery.py"))
# What is committed of small pictures, in bytes.
SMALL = 3_000_000


def names(paths):
    return [path.stem for path in paths]


# Modules that the scripts of a folder share, by the folder: experiments and figures have one `common` each.
_LOADED = {}


@contextmanager
def modules_of(folder):
    """Lets a script import the modules of its folder; they are loaded once, and so are the programs that they make."""
    own = _LOADED.setdefault(folder, {})
    before = sys.modules.copy()
    sys.path.insert(0, str(folder))
    sys.modules.update(own)
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name, module in sys.modules.copy().items():
            if name not in before and Path(getattr(module, "__file__", None) or "/").is_relative_to(folder):
                own[name] = sys.modules.pop(name)


def run(script, *words):
    """Runs a script in this process, as Python runs it: what others compiled or keep need not be compiled again.

    Patched without the fixture: tests that have it read no kept programs.
    """
    with pytest.MonkeyPatch.context() as patches, modules_of(script.parent):
        patches.setattr(sys, "argv", [str(script), *map(str, words)])
        runpy.run_path(str(script), run_name="__main__")


def test_every_experiment_has_a_claim_that_is_asserted():
    assert len(EXPERIMENTS) >= 30
    assert sorted(CLAIMS) == names(EXPERIMENTS)


@pytest.mark.slow
def test_an_experiment_whose_claim_does_not_hold_fails_after_its_numbers_are_written(tmp_path):
    experiment = ROOT / "experiments" / "lin03_transform.py"
    save = f"from common import Run; Run({str(experiment)!r}, None).save({{'line': {{'found': [0]}}}}, 'table')"
    done = python("-c", save, "--smoke", "--out", str(tmp_path), status=1, cwd=experiment.parent)
    assert "AssertionError" in done.stderr and done.stdout == "table\n"
    assert json.loads((tmp_path / "lin03_transform.json").read_bytes())["line"] == {"found": [0]}


def test_every_experiment_has_its_figure_and_every_figure_its_experiment():
    assert names(EXPERIMENTS) == names(FIGURES)


@pytest.mark.parametrize("script", EXPERIMENTS, ids=names(EXPERIMENTS))
def test_an_experiment_states_question_claim_what_it_feeds_and_the_minutes(script):
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    assert text.split("\n")[0].endswith("?")
    assert re.search(r"Claims?:", text)
    assert re.search(r"^Feeds: ", text, re.MULTILINE)
    assert re.search(r"^Takes: .*(minute|second)", text, re.MULTILINE)


@pytest.mark.parametrize("script", FIGURES, ids=names(FIGURES))
def test_a_figure_has_a_caption_with_a_sentence_on_what_it_shows_and_one_on_what_matters(script):
    assert len(re.findall(r"[a-z0-9%)][.;:] ", GALLERY["caption"](script.stem) + " ")) >= 2


def described(script):
    """Alt texts of all pictures of a figure, those that it saves and those in the gallery."""
    name = script.stem
    parts = re.findall(r'picture\.save\(.*, "(_\w+)"\)', script.read_text(encoding="utf-8"))
    drawn = {f"{name}.png", *(f"{name}{part}.png" for part in parts)}
    shown = {file.name for file in GALLERY["pictures"](GALLERY["GALLERY"], name)}
    return [GALLERY["alt_text"](name, file) for file in sorted(drawn | shown)]


@pytest.mark.parametrize("script", FIGURES, ids=names(FIGURES))
def test_every_picture_has_an_alt_text_of_its_own_that_is_no_part_of_the_caption(script):
    texts, caption = described(script), GALLERY["caption"](script.stem)
    assert len(set(texts)) == len(texts)
    for text in texts:
        sentences = re.split(r"(?<=\.) ", text)
        assert len(text.split()) >= 12 and len(text) <= 300 and len(sentences) <= 3 and text.endswith(".")
        assert not any(sentence.rstrip(".") in caption for sentence in sentences)
        assert not set(text) & set("[]`*_\n"), "it stands between brackets in Markdown"


def test_the_contact_sheet_describes_its_pictures():
    sheet = GALLERY["contact_sheet"]({"point_bezier": ["point_bezier.png", "point_bezier_methods.png"]}, {})
    shown = [html.unescape(text) for text in re.findall('alt="([^"]*)"', sheet)]
    assert shown == described(ROOT / "paper_figs" / "point_bezier.py")


def test_the_gallery_page_holds_every_figure_as_captions_and_pictures_are_now():
    assert sorted(GALLERY["names"]()) == names(FIGURES)
    page = (ROOT / "paper_figs" / "gallery" / "README.md").read_text(encoding="utf-8")
    assert page == GALLERY["page"](), "paper_figs/all.py --page writes it anew"
    assert sum(file.stat().st_size for file in GALLERY["GALLERY"].iterdir()) < SMALL


def test_the_readme_stays_short():
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(page.splitlines()) < 200 and max(map(len, page.splitlines())) <= 120


@pytest.mark.slow
def test_the_readme_prints_what_it_shows(capsys):
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    source, shown = re.findall(r"^```(?:python)?\n(.*?)^```", page[page.index("```python") :], re.S | re.M)[:2]
    exec(source, {})
    printed = capsys.readouterr().out
    number = r"-?\d+\.\d*"
    assert re.sub(number, "x", printed) == re.sub(number, "x", shown)
    found, stated = ([float(x) for x in re.findall(number, text)] for text in (printed, shown))
    assert found == pytest.approx(stated, abs=1e-9)


@pytest.mark.parametrize("script", [*EXPERIMENTS, *FIGURES], ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_script_computes_nothing_when_it_is_imported(script):
    body = ast.parse(script.read_text(encoding="utf-8")).body
    assert isinstance(body[-1], ast.If) and ast.unparse(body[-1].test) == "__name__ == '__main__'"


def test_constants_of_an_experiment_take_other_values_of_their_kind():
    names = {"COUNT": 3, "SHARES": (0.1, 0.2), "SIZE": 1.5, "FONT": "DejaVu Sans", "ROWS": np.zeros((2, 2)), "main": 1}
    names |= {"WAYS": {"a function": len}}
    given = ["COUNT=7", "SHARES=(0.5,)", "SIZE=2", "FONT=STIXGeneral", "ROWS=[[1, 2]]"]
    changed = PARAMETERS["change"](names, given)
    assert changed.keys() == names.keys() - {"main", "WAYS"}
    assert names["COUNT"] == 7 and names["SHARES"] == (0.5,) and names["FONT"] == "STIXGeneral"
    assert isinstance(names["SIZE"], float) and names["ROWS"].tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("setting", ["COUNT", "COUNT=0.5", "COUNT=many", "OTHER=1", "main=2"])
def test_what_is_no_value_of_a_constant_is_refused_by_name(setting):
    names = {"COUNT": 3, "main": 1}
    with pytest.raises(ValueError, match=f"--set {setting.partition('=')[0]}"):
        PARAMETERS["change"](names, [setting])
    assert names == {"COUNT": 3, "main": 1}


def test_a_figure_asks_its_experiment_for_what_it_was_asked_for():
    parser = argparse.ArgumentParser()
    PARAMETERS["add_options"](parser, meshes=True, pair=True)
    words = ["--seed", "3", "--set", "A=1", "--set", "B=2", "--meshes", "a.ply", "b.ply"]
    assert PARAMETERS["as_flags"](PARAMETERS["asked"](parser.parse_args(words))) == words
    assert PARAMETERS["asked"](parser.parse_args([])) == {}


def check_origin(numbers, name):
    context = numbers["context"]
    assert context["experiment"] == name and context["smoke"] is True
    assert context["command"].startswith(f"python experiments/{name}.py --smoke")
    assert "--out" not in context["command"]
    assert isinstance(context["seed"], int) and context["device"] and context["asked"] == {}
    assert {"python", "jhd", "jax", "numpy", "scipy"} <= context["versions"].keys()


@pytest.mark.slow
@pytest.mark.parametrize("script", EXPERIMENTS, ids=names(EXPERIMENTS))
def test_an_experiment_runs_small_its_claims_hold_and_its_figure_is_drawn(script, tmp_path, capsys):
    name = script.stem
    run(script, "--smoke", "--out", tmp_path)
    assert (tmp_path / f"{name}.md").read_text(encoding="utf-8").strip() == capsys.readouterr().out.strip()
    written = (tmp_path / f"{name}.json").read_bytes()
    numbers = json.loads(written)
    check_origin(numbers, name)
    CLAIMS[name](numbers)
    run(ROOT / "paper_figs" / script.name, "--smoke", "--out", tmp_path)
    check_pictures(tmp_path, name)
    # A figure takes the numbers that are there.
    assert (tmp_path / f"{name}.json").read_bytes() == written


def check_pictures(folder, name):
    assert (folder / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    assert (folder / f"{name}.pdf").read_bytes()[:4] == b"%PDF"
    if name == "point_bezier":
        assert (folder / "point_bezier.gif").read_bytes()[:6] == b"GIF89a"


@pytest.mark.slow
def test_one_command_draws_what_is_missing_once_and_says_what_is_drawn_of_old_numbers(tmp_path, capsys):
    def draw():
        with pytest.raises(SystemExit, match="^0$"):
            run(ROOT / "paper_figs" / "all.py", "spurious_cells", "--smoke", "--out", tmp_path)
        return capsys.readouterr()

    # The figure, a process of its own, runs its experiment where numbers are missing.
    assert "spurious_cells: drawn" in draw().out
    file = tmp_path / "spurious_cells.json"
    numbers = json.loads(file.read_text(encoding="utf-8"))
    CLAIMS["spurious_cells"](numbers)
    check_pictures(tmp_path, "spurious_cells")
    done = draw()
    assert "1 of 1 are up to date" in done.out and "drawn" not in done.out and done.err == ""
    numbers["context"]["code"]["package"] = "another"
    file.write_text(json.dumps(numbers), encoding="utf-8")
    before = (tmp_path / "spurious_cells.png").read_bytes()
    done = draw()
    assert "spurious_cells: drawn" in done.out and "old numbers: the package changed since" in done.err
    assert (tmp_path / "spurious_cells.png").read_bytes() != before
    assert "old numbers" in (tmp_path / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("script", TOUR, ids=names(TOUR))
def test_a_script_of_the_tour_says_what_it_shows_and_what_it_says_holds(script, tmp_path, capsys):
    assert len(TOUR) == 11 and ast.get_docstring(ast.parse(script.read_text(encoding="utf-8")))
    with chdir(tmp_path):
        run(script)
    assert capsys.readouterr().out
