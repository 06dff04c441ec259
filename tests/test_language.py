"""Texts are plain technical English, counted by words that hide conditions and nouns."""

import argparse
import ast
import inspect
import re
from pathlib import Path

import pytest

import jhd
import jhd.arithmetic
import jhd.io
import jhd.plot
import jhd.progress
import jhd.published
import jhd.typing
from jhd import __main__ as command_line

ROOT = Path(__file__).parent.parent
# Occurrences in 1 000 words: the largest rate of optimistix, diffrax, shapely, bezier and trimesh.
MOST = {
    r"where": 2.0,
    r"what (?:is|it|the|a)": 0.2,
    r"that of|those of": 0.3,
    r"the other one": 0.1,
    r"of it": 0.4,
    r"likewise|as for": 0.1,
    r"so many|so much": 0.1,
    r"beside": 0.1,
    r"shares?": 0.2,
    r"kinks?": 0.1,
    r"polynomial surfaces?": 0.1,
}
VAGUE = re.compile(r"^ +\w+: *(likewise|as for|the other|theirs|see \w+\.?$)", re.M)
MODULES = jhd, jhd.io, jhd.plot, jhd.arithmetic, jhd.published, jhd.progress, jhd.typing


def public_docstrings():
    """Docstrings of everything that is exported, by name, with the objects."""
    found = {}
    for module in MODULES:
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


def parsed(folder):
    """The syntax trees of all files below a folder."""
    return [ast.parse(path.read_text(encoding="utf-8")) for path in sorted((ROOT / folder).rglob("*.py"))]


def docstrings(folder):
    """All docstrings below a folder, private ones too."""
    nodes = (node for tree in parsed(folder) for node in ast.walk(tree))
    every = (ast.get_docstring(x) for x in nodes if isinstance(x, ast.Module | ast.ClassDef | ast.FunctionDef))
    return "\n\n".join(text for text in every if text)


def messages():
    """The texts of all errors that the package raises, and the sentences of its enumerations."""
    raised = [node for tree in parsed("jhd") for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    texts = [part.value for node in raised for part in ast.walk(node) if isinstance(part, ast.Constant)]
    kinds = jhd.RESULTS, jhd.EVENTS, jhd.ANSWERS, jhd.DIRECTIONS
    said = [kind[getattr(kind, name)] for kind in kinds for name in kind._name_to_item]
    return "\n".join([text for text in texts if isinstance(text, str)] + said)


def helps():
    """The help of the command line and of all its commands."""
    parser = command_line._parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return "\n".join([parser.format_help(), *(one.format_help() for one in commands.choices.values())])


def pages():
    """The pages in Markdown, the gallery with its captions and descriptions of pictures too."""
    return "\n".join((ROOT / name).read_text(encoding="utf-8") for name in PAGES)


def words_only(text):
    """A text without code, examples and markup."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    return re.sub(r"`[^`]*`", "", re.sub(r"^ *>>>.*\n(?:^ *\S.*\n)?", "", text, flags=re.M))


PAGES = "README.md", "experiments/README.md", "paper_figs/gallery/README.md"
TEXTS = {"package": lambda: docstrings("jhd"), "experiments": lambda: docstrings("experiments")}
TEXTS |= {"figures": lambda: docstrings("paper_figs"), "messages": messages, "help": helps, "pages": pages}
FOUND = public_docstrings()
PROSE = " ".join(re.sub(r"^ *>>>.*\n(?:^ *\S.*\n)?", "", text, flags=re.M) for text in {t for t, _ in FOUND.values()})


def test_there_is_prose_to_count():
    assert len(FOUND) > 250 and len(PROSE.split()) > 15_000


@pytest.mark.parametrize("phrase", MOST)
def test_a_phrase_is_as_rare_as_elsewhere(phrase):
    rate = 1000 * len(re.findall(rf"\b(?:{phrase})\b", PROSE, re.I)) / len(PROSE.split())
    assert rate <= MOST[phrase]


@pytest.mark.parametrize("kind", TEXTS)
def test_private_texts_messages_help_and_pages_are_as_plain(kind):
    text = words_only(TEXTS[kind]())
    count = len(text.split())
    assert count > 2_000
    found = {phrase: len(re.findall(rf"\b(?:{phrase})\b", text, re.I)) for phrase in MOST}
    # Two of a kind are no habit.
    assert {phrase: n for phrase, n in found.items() if n > max(2, MOST[phrase] * count / 1000)} == {}


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
    assert [name for name, text in functions.items() if "Args:" in text and "Returns:" not in text] == []
    assert [name for name, text in plain.items() if ">>> " not in text] == []


def test_an_example_can_be_pasted_from_the_help():
    shown = {name: re.findall(r"^ *(?:>>>|\.\.\.) (.*)$", text, re.M) for name, (text, _) in FOUND.items()}
    shown = {name: lines for name, lines in shown.items() if lines}
    assert len(shown) > 90
    assert [name for name, lines in shown.items() if "import jhd" not in lines] == []
    assert [name for name, lines in shown.items() if any("jhd._" in line for line in lines)] == []
