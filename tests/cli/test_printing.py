"""Results as lines and as JSON: nested, in tables, without control characters."""

import json
import math

import numpy as np
import pytest

from jradar.cli import main
from jradar.cli.printing import as_json, identifier, lines
from jradar.errors import printable
from jradar.progress import progress

TITLE = "\x1b]0;owned\x07"  # sets the title of a terminal's window


def test_a_result_as_lines():
    result = {
        "frames": 3,
        "shape": [3, 4],
        "place": [0.03, -0.123456, 12.0],
        "radar": {"elevation": True, "range": 0.1249057, "speed": 12.3456},
        "streams": [{"name": "radar", "hz": 10.0}, {"name": "lidar", "hz": None}],
        "notes": ["one", "two"],
        "nothing": [],
        "none lost": 0,
        "a name of more than 27 letters": 1,
    }
    assert (
        "\n".join(lines(result))
        == """\
frames                      3
shape                       3 x 4
place                       0.03  -0.1235  12
radar
  elevation                   yes
  range                       0.1249
  speed                       12.35
streams
   name     hz
  radar  10.00
  lidar      -
notes
  one
  two
none lost                   0
a name of more than 27 letters 1"""
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("frames/s", "frames_per_s"),
        ("largest (m/s)", "largest_mps"),
        ("latency, 95 % (ms)", "latency_95_percent_ms"),
        ("in the radar's view", "in_the_radars_view"),
        ("SNR (dB)", "snr_db"),
        ("range_m", "range_m"),
    ],
)
def test_names_become_identifiers(name, expected):
    assert identifier(name) == expected


def test_numbers_that_are_not_finite_become_null():
    result = {"a": math.inf, "b (m)": [math.nan, 1.5], "c": {"d e": -math.inf}}
    found = json.loads(as_json(result), parse_constant=pytest.fail)
    assert found == {"a": None, "b_m": [None, 1.5], "c": {"d_e": None}}


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


def test_rows_of_a_table_may_lack_a_value():
    rows = [{"frame": 0, "f": 0.5}, {"frame": 1}, {"frame": 2, "empty": True}]
    _, *table = lines({"frames": rows})
    assert [row.split() for row in table] == [
        ["frame", "f", "empty"],
        ["0", "0.5", "-"],
        ["1", "-", "-"],
        ["2", "-", "yes"],
    ]


def test_text_from_files_is_escaped_wherever_it_is_printed(tmp_path, capsys, refused):
    path = tmp_path / f"{TITLE}a.ply"
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", TITLE))
    path.write_bytes(f"{head}end_header\n".encode() + np.ones(4, "<f4").tobytes())
    assert main(["info", str(path)]) == 0
    out = capsys.readouterr().out
    assert r"x y z \x1b]0;owned\x07" in out and "\x1b" not in out
    assert main(["info", str(path), "--json"]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out and json.loads(out)["cloud"] == str(path)
    path.write_bytes(b"ply\n")
    err = refused("info", path, code=4)
    assert r"\x1b]0;owned\x07a.ply is damaged or not" in err and "\x1b" not in err
    assert "\x1b" not in refused("info", path, f"--{TITLE}")
    with progress("preparing", 1) as show:
        show(1, TITLE)
    assert "\x1b" not in capsys.readouterr().err
