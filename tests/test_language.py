"""Public docstrings are plain technical English, counted by words that hide conditions and nouns."""

import inspect
import re

import pytest

import jhd
import jhd.arithmetic
import jhd.io
import jhd.plot

# Occurrences in 1 000 words: the largest rate of optimistix, diffrax, shapely, bezier and trimesh.
MOST = {
    r"where": 2.0,
    r"what (?:is|it|the|a)": 0.2,
    r"that of|those of": 0.3,
    r"the other one": 0.1,
    r"of it": 0.3,
    r"beside": 0.1,
    r"shares?": 0.1,
    r"kinks?": 0.1,
    r"polynomial surfaces?": 0.1,
}
VAGUE = re.compile(r"^ +\w+: *(likewise|as for|the other|theirs|see \w+\.?$)", re.M)


def public_docstrings():
    """Docstrings of everything that is exported, by name, with the objects."""
    found = {}
    for module in (jhd, jhd.io, jhd.plot, jhd.arithmetic):
        for name in getattr(module, "__all__", vars(module)):
            held = getattr(module, name)
            if name.startswith("_") or not getattr(held, "__module__", "").startswith("jhd"):
                continue
            members = {name: held}
            if inspect.isclass(held):
                members |= {f"{name}.{k}": v for k, v in inspect.getmembers(held) if not k.startswith("_")}
            for key, member in members.items():
                text = inspect.getdoc(member)
                ours = getattr(getattr(member, "fget", member), "__module__", "") or ""
                if text and ours.startswith("jhd"):
                    found[f"{module.__name__}.{key}"] = (text, member)
    return found


FOUND = public_docstrings()
PROSE = " ".join(re.sub(r"^ *>>>.*\n(?:^ *\S.*\n)?", "", text, flags=re.M) for text in {t for t, _ in FOUND.values()})


def test_there_is_prose_to_count():
    assert len(FOUND) > 250 and len(PROSE.split()) > 15_000


@pytest.mark.parametrize("phrase", MOST)
def test_a_phrase_is_as_rare_as_elsewhere(phrase):
    rate = 1000 * len(re.findall(rf"\b(?:{phrase})\b", PROSE, re.I)) / len(PROSE.split())
    assert rate <= MOST[phrase]


def test_conditions_are_said_by_if():
    assert 1000 * len(re.findall(r"\b(?:if|when)\b", PROSE, re.I)) / len(PROSE.split()) >= 4


def test_each_argument_is_described_by_itself():
    assert [name for name, (text, _) in FOUND.items() if VAGUE.search(text)] == []


def test_each_function_says_what_it_returns_and_shows_it():
    classes = {name for name, (_, held) in FOUND.items() if inspect.isclass(held)}
    functions = {name: text for name, (text, held) in FOUND.items() if inspect.isfunction(held)}
    plain = {name: text for name, text in functions.items() if name.rpartition(".")[0] not in classes}
    assert len(plain) > 60
    assert [name for name, text in plain.items() if "Returns:" not in text] == []
    # The smallest example of critical_pairs compiles for ten seconds.
    assert [name for name, text in plain.items() if ">>> " not in text] == ["jhd.critical_pairs"]


def test_an_example_can_be_pasted_from_the_help():
    shown = {name: re.findall(r"^ *(?:>>>|\.\.\.) (.*)$", text, re.M) for name, (text, _) in FOUND.items()}
    shown = {name: lines for name, lines in shown.items() if lines}
    assert len(shown) > 90
    assert [name for name, lines in shown.items() if "import jhd" not in lines] == []
    assert [name for name, lines in shown.items() if any("jhd._" in line for line in lines)] == []
