"""Results as lines: nested, in tables, with as many digits as people read."""

from jradar.cli.listing import lines


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
none lost                   0"""
    )


def test_a_long_name_keeps_its_distance():
    assert [*lines({"a name of more than 27 letters": 1})] == [
        "a name of more than 27 letters 1"
    ]
