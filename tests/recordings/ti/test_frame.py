"""Frames of TI's chips: what belongs to the radar, boards; what is refused."""

import pytest

from jradar.errors import UsageError
from jradar.recordings.ti.frame import MAX_CHIRPS, Chirp, radar_of_frame

STILL = (0, 0, 0, 0)  # no variations
FRAME = {
    "profiles": {0: (77, 267, 7, 57.14, 70, 256, 5209)},
    "chirps": {n: Chirp(0, STILL, [tx]) for n, tx in enumerate((0, 2, 1))},
}
FRAME |= {"ends": (0, 2), "turns": 16, "period_s": 0.1, "rx_mask": 15, "tx_mask": 7}


def read(device="awr1843", **changes):
    return radar_of_frame("a.cfg", device, **(FRAME | changes))


def chirps(number=1, **changes):
    """The chirps of the frame, one of them changed."""
    changed = FRAME["chirps"][number]._replace(**changes)
    return {"chirps": FRAME["chirps"] | {number: changed}}


def test_only_what_is_on_belongs_to_the_radar():
    radar, tx, rx = read(rx_mask=0b11010, ends=(0, 1), tx_mask=None)
    assert radar.tx_positions == ((0, 0), (4, 0)) and tx == [0, 2]
    assert radar.rx_positions == ((1, 0), (3, 0)) and rx == [1, 3]


@pytest.mark.parametrize(
    ("device", "start_ghz", "positions"),
    [
        ("awr1443", 77, ((0, 0), (4, 0), (2, 1))),
        ("iwr6843isk", 60.25, ((0, 0), (4, 0), (2, 1))),
        ("awr2944", 76.5, ((0, 0), (4, 0), (2, 1))),
    ],
)
def test_each_board_has_its_positions(device, start_ghz, positions):
    profile = (start_ghz, *FRAME["profiles"][0][1:])
    radar, _, _ = read(device, profiles={0: profile})
    assert (radar.name, radar.tx_positions) == (device, positions)
    assert 0.48 < radar.spacing_wavelengths < 0.52
    assert radar.real_samples == (device == "awr2944")
    assert radar.row_spacing == (1.6 if device == "awr2944" else 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ends": (0, 3)}, r"incomplete .* 0 to 3, described are \[0, 1, 2\]"),
        ({"ends": (0, 511)}, "incomplete configuration: .* 0 to 511"),
        ({"ends": (2, 0)}, "chirps 2 to 0, expected 0 to 511 in rising order"),
        ({"ends": (0, MAX_CHIRPS)}, "chirps 0 to 512, expected 0 to 511"),
        ({"ends": (-(2**31) - 1, 1)}, "number = -2.14748e.09, expected a whole"),
        ({"ends": (0, 60_000_000)}, "chirp's number = 6e.07, expected a whole"),
        (chirps(variations=(0, 5, 0, 0)), "differ in profile, frequency, slope"),
        (chirps(profile=1), "differ in profile, frequency, slope"),
        ({"profiles": {3: ()}}, r"use profile 0, described are \[3\]"),
        (chirps(tx=[0, 2]), r"\[\[0\], \[0, 2\], \[1\]\], expected each chirp"),
        (chirps(tx=[]), "expected each chirp to fire one"),
        (chirps(tx=[0]), "each transmitter to fire once"),
        ({"tx_mask": 5}, r"transmitters \[0, 2\] are enabled, the frame needs"),
        ({"rx_mask": 16}, r"receivers \[\] and .* needs at least one receiver"),
        ({"rx_mask": 2.5}, "a mask = 2.5, expected a whole number from 0 to 65535"),
        ({"turns": 16.5}, "num_chirps = 16.5, expected a whole number"),
        ({"turns": 0}, "num_chirps = 0, expected more"),
        ({"turns": -4}, "num_chirps = -4, expected a whole number"),
        ({"profiles": {0: (77, 267, 7, 50, 70, 256, 5209)}}, "sampling ends 56.15 us"),
    ],
)
def test_frames_that_a_radar_cannot_have_are_refused(changes, message):
    with pytest.raises(ValueError, match=f"a.cfg.*{message}"):
        read(**changes)


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("iwr6843", "device = 'iwr6843', expected one of .* iwr6843ods"),
        ("awr1642", r"fires transmitters \[0, 2, 1\] at 77 GHz, the awr1642 has 2"),
        ("iwr6843isk", "has 3, and works from 60 to 64 GHz: name the board, one of"),
    ],
)
def test_an_unknown_or_another_board_is_refused(device, message):
    with pytest.raises(UsageError, match=message):
        read(device)
