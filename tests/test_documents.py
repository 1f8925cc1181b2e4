"""Numbers of README and RESULTS are those of results.json, with where they are from."""

import json
import re
from pathlib import Path

import pytest

from tests.test_readme import README, TEXTS

ROOT = Path(__file__).parents[1]
FILE = json.loads((ROOT / "experiments" / "results.json").read_text())
ENTRIES = FILE["entries"]
BLOCKS = {
    "README": README.split("## What it reaches")[1].split("\n## ")[0],
    "RESULTS": TEXTS["experiments/RESULTS"],
}
MARK = re.compile(r"<!-- results\.json:([a-z_ ]*)-->\n")
DATE, COMMIT = re.compile(r"\d{4}-\d\d-\d\d"), re.compile(r"`([0-9a-f]{7})`")
NUMBER = re.compile(r"(?<![\w.\-–/])-?\d[\d,]*(?:\.\d+)?(?![\w]*[-_]\w)")
CELL = re.compile(r"-?\d[\d,]*(?:\.\d+)?")


def blocks():
    """(file, keys, text) of every paragraph and table; keys are None without a mark."""
    for name, text in BLOCKS.items():
        text = re.sub(r"```bash\n.*?```", "", text, flags=re.DOTALL)
        for block in re.split(r"\n\s*\n", text):
            found = MARK.search(block)
            yield name, found and found[1].split(), MARK.sub("", block).strip()


def values(entry):
    """Every number of an entry."""
    for value in (*entry["values"].values(), *entry["settings"].values()):
        yield from value if isinstance(value, list) else [value]


def shown(text, pattern=NUMBER):
    """The numbers of a text as (value, decimals), without code, links and dates."""
    text = DATE.sub("", re.sub(r"\]\([^)]*\)|`[^`]*`", "", text))
    for found in pattern.findall(text):
        yield float(found.replace(",", "")), len(found.partition(".")[2])


def plain(cell):
    return re.sub(r"[*`]", "", cell).strip()


def rows(block):
    """(row, column, cell) of a Markdown table, without its first column."""
    lines = [line.strip("|").split("|") for line in block.splitlines()]
    header = [plain(cell) for cell in lines[0]]
    for line in lines[2:]:
        label, *cells = map(plain, line)
        yield from ((label, *each) for each in zip(header[1:], cells, strict=True))


TABLES = [b for b in blocks() if b[2].startswith("|") and b[1] is not None]
SENTENCES = [b for b in blocks() if not b[2].startswith(("|", "#"))]


@pytest.mark.parametrize(("name", "keys", "block"), TABLES)
def test_every_cell_of_a_table_is_in_the_file(name, keys, block):
    known = {k: v for key in keys for k, v in ENTRIES[key]["values"].items()}
    for row, column, cell in rows(block):
        expected = known.get(f"{row} | {column}", [])
        expected = expected if isinstance(expected, list) else [expected]
        found = [*shown(cell, CELL)]
        where = f"{name}: {row} | {column}: {cell}"
        assert len(found) in (1, len(expected)) if expected else not found, where
        for (number, decimals), value in zip(found, expected, strict=False):
            assert number == round(value, decimals), where


@pytest.mark.parametrize(("name", "keys", "block"), SENTENCES)
def test_every_number_of_a_sentence_is_in_the_file(name, keys, block):
    entries = [ENTRIES[key] for key in keys or ()]
    known = [v for entry in entries for v in values(entry)]
    known += FILE["settings"].values() if keys is not None else ()
    for number, decimals in shown(block):
        near = any(number == round(value, decimals) for value in known)
        assert near, f"{name}: {number} in {block!r}"
    dates = {entry["date"] for entry in entries}
    assert {*DATE.findall(block)} <= dates, block
    sources = "".join(f"{e['commit']} {e['weights']} {e['data']}" for e in entries)
    assert all(commit in sources for commit in COMMIT.findall(block)), block


def test_tables_with_numbers_name_their_entries():
    for name, keys, block in blocks():
        if block.startswith("|") and keys is None:
            assert not [*shown(block)], f"{name}: {block[:60]}"


def test_every_entry_is_whole_and_its_command_stands_in_the_results():
    shown_commands = re.findall(r"```bash\n(.*?)```", BLOCKS["RESULTS"], re.DOTALL)
    for key, entry in ENTRIES.items():
        assert re.fullmatch(r"\d{4}-\d\d(-\d\d)?", entry["date"]), key
        assert re.fullmatch(r"[0-9a-f]{7}|outside", entry["commit"]), key
        assert entry["data"] and entry["weights"] and entry["values"], key
        if entry["commit"] != "outside":
            assert entry["command"] in "".join(shown_commands), key
    used = {key for _, keys, _ in blocks() for key in keys or ()}
    assert used == ENTRIES.keys()


@pytest.mark.parametrize(
    ("name", "most"),
    [("experiments/RESULTS.md", 1800), ("experiments/lab", 8000), ("README.md", 900)],
)
def test_documents_are_short(name, most):
    path = ROOT / name
    files = path.glob("*.md") if path.is_dir() else [path]
    assert 0 < sum(len(file.read_text().split()) for file in files) <= most
