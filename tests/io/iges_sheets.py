"""IGES files for tests, put together column by column as the standard says, and taken apart again likewise."""

import re


def sheet(*entities, start="1H,,1H;,", parameter=",", record=";", end="\n"):
    """The bytes of a file; an entity is a text of parameters with type first, or such a text and its directory fields.

    Directory fields are matrix, status and form; parameters of an entity are written with commas and a semicolon.
    """
    directory, parameters = [], []
    for index, entity in enumerate(entities):
        text, fields = (entity, {}) if isinstance(entity, str) else entity
        sequence, kind = 2 * index + 1, text.split(",")[0]
        text = text.replace(";", record) if parameter == "," else text.replace(",", parameter).replace(";", record)
        rows = [text[k : k + 64] for k in range(0, len(text), 64)]
        first = [kind, len(parameters) + 1, 0, 0, 0, 0, fields.get("matrix", 0), 0]
        second = [kind, 0, 0, len(rows), fields.get("form", 0), "", "", "", 0]
        directory.append("".join(f"{x:>8}" for x in first) + fields.get("status", "00000000"))
        directory.append("".join(f"{x:>8}" for x in second))
        parameters += [f"{row:<64}{sequence:>8}" for row in rows]
    whole = start + parameter.join(
        ["4Hpart", "9Hpart; 1,2", "", "", "32", "308", "15", "308", "15", "", "1.", "2,2HMM".replace(",", parameter)]
    )
    whole += record
    sections = {
        "S": ["a file for a test"],
        "G": [whole[k : k + 72] for k in range(0, len(whole), 72)],
        "D": directory,
        "P": parameters,
    }
    sections["T"] = ["".join(f"{letter}{len(lines):07}" for letter, lines in sections.items())]
    lines = [
        f"{line:<72}{letter}{number:>7}" for letter, rows in sections.items() for number, line in enumerate(rows, 1)
    ]
    return "".join(line + end for line in lines).encode("latin-1")


def entities_of(content):
    """What a file holds, read by columns: a list of (type, matrix, status, form, parameters) in directory order."""
    lines = content.decode("ascii").split("\n")
    assert lines.pop() == "" and all(len(line) == 80 for line in lines)
    sections = {letter: [line for line in lines if line[72] == letter] for letter in "SGDPT"}
    assert [line for rows in sections.values() for line in rows] == lines
    for rows in sections.values():
        assert [int(line[73:]) for line in rows] == list(range(1, len(rows) + 1))
    counts = re.findall(r"([SGDP])([0-9]{7})", sections["T"][0][:72])
    assert counts == [(letter, f"{len(sections[letter]):07}") for letter in "SGDP"]
    found = []
    for first, second in zip(sections["D"][::2], sections["D"][1::2], strict=True):
        kind, pointer, matrix = (int(first[8 * k : 8 * k + 8]) for k in (0, 1, 6))
        count, form = int(second[24:32]), int(second[32:40])
        assert int(second[:8]) == kind
        rows = sections["P"][pointer - 1 : pointer - 1 + count]
        assert all(line[64] == " " and int(line[65:72]) == int(first[73:]) for line in rows)
        text = "".join(line[:64] for line in rows).strip()
        assert text.endswith(";")
        words = [word.strip() for word in text[:-1].split(",")]
        assert int(words[0]) == kind
        # A real number has a decimal point, and double precision is marked by D (section 2.2.2.2).
        assert all(re.fullmatch(r"-?[0-9]+|-?[0-9]+\.[0-9]*(D[+-]?[0-9]+)?", word) for word in words), words
        found.append((kind, matrix, first[64:72], form, [float(word.replace("D", "E")) for word in words[1:]]))
    return found
