"""Text from files reaches the terminal with its control characters escaped."""

import json

import numpy as np
import pytest

from jradar.cli import main
from jradar.cli.listing import lines
from jradar.errors import printable
from jradar.progress import progress

TITLE = "\x1b]0;owned\x07"  # sets the title of a terminal's window


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Grüße, 5 µs, 点云", "Grüße, 5 µs, 点云"),
        (TITLE, r"\x1b]0;owned\x07"),
        ("a\nb\tc\x7f\x9b", r"a\nb\tc\x7f\x9b"),
        ("\u202egnp.exe", r"\u202egnp.exe"),  # reverses what follows
        ("\udcff", r"\udcff"),  # a file's name that is not UTF-8
    ],
)
def test_control_characters_are_escaped(text, expected):
    assert printable(text) == expected
    found = {"name": text, "notes": [text], "rows": [{"topic": text}]}
    assert "".join(lines(found)).count(expected) == 3
    assert text.isprintable() or text not in "".join(lines(found))


def test_columns_are_as_wide_as_the_escaped_texts():
    rows = [{"topic": TITLE, "hz": 1}, {"topic": "/long", "hz": 2}]
    _, *table = lines({"topics": rows})
    assert len({len(row) for row in table}) == 1


def test_fields_of_a_cloud_and_errors_and_names_of_files(tmp_path, capsys):
    path = tmp_path / f"{TITLE}a.ply"
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", TITLE))
    path.write_bytes(f"{head}end_header\n".encode() + np.ones(4, "<f4").tobytes())
    assert main(["info", str(path)]) == 0
    out = capsys.readouterr().out
    assert r"x y z \x1b]0;owned\x07" in out and "\x1b" not in out
    path.write_bytes(b"ply\n")
    assert main(["info", str(path)]) == 4
    err = capsys.readouterr().err
    assert r"\x1b]0;owned\x07a.ply is damaged" in err and "\x1b" not in err
    with pytest.raises(SystemExit):
        main(["info", str(path), f"--{TITLE}"])
    assert "\x1b" not in capsys.readouterr().err


def test_names_in_json_are_escaped(tmp_path, capsys):
    path = tmp_path / f"{TITLE}a.bin"
    path.write_bytes(np.ones(4, "<f4").tobytes())
    assert main(["info", "--json", str(path)]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out and json.loads(out)["cloud"] == str(path)


def test_notes_of_progress(capsys):
    with progress("preparing", 1) as show:
        show(1, TITLE)
    assert "\x1b" not in capsys.readouterr().err
