"""Two cards behind one address: one of them is followed, the other one named."""

import re

import numpy as np
import pytest

from tests.stream.loops import RACES, deliver, receiving, taken
from tests.stream.packets import assemble, packets_of, random_frames

SIZE = 5 * 1456
OURS, THEIRS = random_frames(300, SIZE, seed=1), random_frames(300, SIZE, seed=2)


def mixed(ahead, burst, theirs=THEIRS):
    """Packets of both, in bursts by turns; the second began `ahead` frames earlier."""
    first, second = ahead * 5 + 1, ahead * SIZE
    streams = packets_of(OURS), packets_of(theirs, first=first, place=second)
    for at in range(0, 5 * len(OURS), burst):
        for stream in streams:
            yield from stream[at : at + burst]


@pytest.mark.parametrize("burst", [1, 3, 5, 10])
@pytest.mark.parametrize("ahead", [20, 50, 100, 100_000])
def test_one_of_two_cards_is_followed(ahead, burst):
    frames, counts = assemble(mixed(ahead, burst), SIZE)
    sent = {frame.tobytes(): 0 for frame in OURS} | {f.tobytes(): 1 for f in THEIRS}
    whose = [sent[frame.data.tobytes()] for frame in frames[-250:]]
    assert len({*whose}) == 1 and counts.restarts <= 1
    assert counts.ignored > 5 * 250 and counts.missing + counts.sparse <= 100
    assert counts.lost_packets <= 5 * 100


def test_a_card_that_is_switched_off_is_left_for_the_other():
    both = [*mixed(100_000, 5)]
    alone = packets_of(THEIRS, first=5 * 200_000 + 1, place=200_000 * SIZE)
    frames, counts = assemble([*both[: 10 * 200], *alone], SIZE)
    np.testing.assert_array_equal([f.data for f in frames[-250:]], THEIRS[-250:])


def test_a_gap_of_minutes_ends_after_some_frames():
    after = packets_of(THEIRS, first=10**6 + 1, place=10**6 * 1456)
    frames, counts = assemble([*packets_of(OURS), *after], SIZE)
    np.testing.assert_array_equal([f.data for f in frames[-250:]], THEIRS[-250:])
    assert counts.missing > 190_000 and not counts.restarts
    assert frames[-1].number == 10**6 // 5 + 299


def test_a_frame_of_which_less_than_half_arrived_is_not_delivered():
    packets = packets_of(OURS)
    kept = [one for i, one in enumerate(packets) if i // 5 != 100 or i % 5 < 2]
    kept = [one for i, one in enumerate(kept) if i // 5 != 50 or i % 5 < 3]
    frames, counts = assemble(kept, SIZE)
    assert [counts.sparse, counts.damaged, counts.lost_packets] == [1, 1, 5]
    numbers = [frame.number for frame in frames]
    assert 50 in numbers and 100 not in numbers and counts.frames == len(frames) == 299


@RACES
@pytest.mark.parametrize(
    ("packets", "expected"),
    [
        (
            [*mixed(100_000, 5, THEIRS[:60])],
            "packets from 127.0.0.2 whose counters .* do two cards have this address?",
        ),
        ([*mixed(0, 5)][:400], "Their frames are mixed: switch one off"),
    ],
    ids=["apart", "alike"],
)
def test_two_cards_are_named(packets, expected):
    with receiving(SIZE) as (receiver, card):
        deliver(card, receiver, packets)
        assert re.search(expected, receiver.oddity())
        assert len(taken(receiver)) >= 40
