"""Assembler: the bytes of the file whatever the network does; every packet counted."""

import numpy as np
import pytest

from jradar.stream.assembler import Assembler
from tests.stream.packets import assemble, packet, packets_of, random_frames, spoiled

FRAMES = random_frames(40)
SIZE = FRAMES.shape[1]


def added_up(counts):
    kinds = ("placed", "repeated", "late", "ignored", "malformed", "foreign")
    return counts.packets == sum(getattr(counts, kind) for kind in kinds)


@pytest.mark.parametrize("size", [1, 700, 1456, 2400, 2912, 9001])
def test_frames_of_any_size_come_back(size):
    sent = random_frames(30, size)
    frames, counts = assemble(packets_of(sent), size)
    if not size % 1456:  # the last packet delivers the last frame
        assert len(assemble(packets_of(sent), size, flush=False)[0]) == 30
    np.testing.assert_array_equal([frame.data for frame in frames], sent)
    assert [frame.number for frame in frames] == [*range(30)]
    assert counts.lost_bytes == counts.damaged == counts.unfinished == 0


@pytest.mark.parametrize("seed", range(20))
def test_undamaged_frames_are_those_of_the_file(seed):
    """Loss, reordering by 8 and duplicates, while both counters wrap around."""
    place = 2**48 // SIZE * SIZE - 13 * SIZE
    sent = packets_of(FRAMES, first=2**32 - 20, place=place)
    arriving = spoiled(sent, loss=0.05, reorder=8, duplicate=0.1, seed=seed)
    frames, counts = assemble(arriving, SIZE)
    first = place // SIZE
    for frame in frames:
        original = FRAMES[frame.number - first]
        arrived = frame.data == original
        if not frame.lost_bytes:
            assert arrived.all()
        assert not frame.data[~arrived].any()
        assert (~arrived).sum() <= frame.lost_bytes
    counted = counts.frames + counts.sparse + counts.missing + counts.unfinished
    assert counted == len(FRAMES)
    lost = len(sent) - len({*arriving})
    assert counts.placed == len(sent) - lost
    assert counts.repeated == len(arriving) - counts.placed
    lost_bytes = sum(len(one) - 10 for one in {*sent} - {*arriving})
    assert counts.lost_bytes == lost_bytes
    assert added_up(counts) and not counts.restarts


def test_without_loss_nothing_is_damaged_by_order_or_copies():
    arriving = spoiled(packets_of(FRAMES), reorder=8, duplicate=0.5)
    frames, counts = assemble(arriving, SIZE)
    np.testing.assert_array_equal([frame.data for frame in frames], FRAMES)
    assert counts.damaged == counts.missing == 0
    assert counts.repeated == len(arriving) - len(packets_of(FRAMES))


def test_lost_bytes_are_zeros_in_a_buffer_that_was_used_before():
    frames = []

    def take(frame):
        frames.append(frame.data.copy())
        assembler.recycle(frame.data)

    assembler = Assembler(2912, take)
    packets = packets_of(np.full((200, 2912), 7, np.uint8))
    for number, one in enumerate(packets):
        if number != 300:
            assembler.add(one)
    assembler.flush()
    assert not frames[150][:1456].any() and (frames[150][1456:] == 7).all()
    assert (np.delete(frames, 150, 0) == 7).all()


def test_a_card_that_starts_again_goes_on_with_the_next_number():
    """Once it has sent more than the window, by which packets may be late."""
    long = random_frames(100)
    again = spoiled(packets_of(FRAMES), reorder=8, seed=3)
    frames, counts = assemble([*packets_of(long), *again], SIZE)
    expected = np.concatenate([long, FRAMES])
    np.testing.assert_array_equal([frame.data for frame in frames], expected)
    assert [frame.number for frame in frames] == [*range(140)]
    assert counts.restarts == 1 and added_up(counts)


def test_a_frame_in_which_the_card_stopped_is_counted_and_left_out():
    packets = packets_of(random_frames(9, 10 * 1456))
    frames, counts = assemble([*packets[:85], *packets[:70]], 10 * 1456)
    assert len(frames) == 8 + 7
    assert counts.unfinished == 1 and counts.restarts == 1 and not counts.lost_bytes


def test_a_gap_of_many_frames_is_counted_as_missing():
    packets = packets_of(FRAMES)
    frames, counts = assemble([*packets[:5], *packets[40:]], SIZE)
    assert counts.frames + counts.sparse + counts.missing == len(FRAMES)
    assert counts.missing >= 20 and not counts.restarts
    np.testing.assert_array_equal(frames[-1].data, FRAMES[-1])


def test_a_stream_that_is_joined_in_the_middle_begins_with_its_frame():
    sent = random_frames(40, 5 * 1456)
    frames, counts = assemble(packets_of(sent)[112:], 5 * 1456)
    assert [frame.number for frame in frames] == [*range(22, 40)]
    assert [frame.lost_bytes > 0 for frame in frames] == [True] + 17 * [False]
    assert not counts.missing


def test_packets_that_come_far_too_late_are_ignored_and_counted():
    packets = packets_of(FRAMES)
    arriving = [*packets[:90]]
    for at in (89, 85, 80):
        arriving.insert(at, packets[3])
    for window in (0, 20 * 1456):
        frames, counts = assemble([*arriving, *packets[90:]], SIZE, window=window)
        np.testing.assert_array_equal([f.data for f in frames], FRAMES[: len(frames)])
        assert counts.late == 3 and not counts.restarts and added_up(counts)


@pytest.mark.parametrize(
    ("lie", "counted"),
    [
        (packet(21, 10**12, b"x" * 1456), "ignored"),
        (packet(3_000_000, 20 * 1456, b"x" * 1456), "ignored"),
        (packet(21, 20 * 1456, b"x" * 1457), "malformed"),
        (packet(21, 20 * 1456, b""), "malformed"),
        (b"x" * 9, "malformed"),
    ],
    ids=["place", "number", "too long", "no samples", "no header"],
)
def test_a_packet_that_lies_changes_no_frame(lie, counted):
    packets = packets_of(FRAMES)
    frames, counts = assemble([*packets[:20], lie, *packets[20:]], SIZE)
    np.testing.assert_array_equal([frame.data for frame in frames], FRAMES)
    assert getattr(counts, counted) == 1 and added_up(counts)


def test_a_card_may_end_its_packets_with_the_frame():
    """Its counters then differ: by bytes, fewer packets have come than by number."""
    packets = []
    for place in range(0, FRAMES.size, SIZE):
        for at, end in ((place, place + 1456), (place + 1456, place + SIZE)):
            packets.append(packet(len(packets) + 1, at, FRAMES.ravel()[at:end]))
    frames, counts = assemble(packets, SIZE)
    np.testing.assert_array_equal([frame.data for frame in frames], FRAMES)
    assert counts.placed == len(packets) and not counts.restarts


def test_a_packet_with_fewer_bytes_than_the_next_one_counts_leaves_zeros():
    packets = packets_of(FRAMES)
    packets[20] = packets[20][:500]
    frames, counts = assemble(packets, SIZE)
    assert counts.lost_bytes == 1456 - 490 and counts.damaged in (1, 2)
    same = [np.array_equal(f.data, FRAMES[f.number]) for f in frames]
    assert same.count(False) == counts.damaged


def test_random_packets_need_bounded_memory():
    rng = np.random.default_rng(0)
    assembler = Assembler(SIZE, lambda frame: None)
    for one in packets_of(FRAMES[:4]):
        assembler.add(one)
    for _ in range(3000):
        counters = rng.integers(0, 2**32), rng.integers(0, 2**48)
        assembler.add(packet(*map(int, counters), b"x" * 100))
        assert len(assembler._open) <= 64 and len(assembler._aside) <= 4
    assert added_up(assembler.counts) or assembler._aside


def test_a_frame_without_bytes_is_refused():
    with pytest.raises(ValueError, match="expected a frame of 1 byte or more"):
        Assembler(0, print)


@pytest.mark.parametrize("size", [700, 2400, 2912, 300_000])
@pytest.mark.parametrize("seed", range(6))
def test_batches_of_packets_are_taken_as_one_by_one(size, seed):
    """Also of damaged streams, of a card that starts again, and of a second one."""
    rng = np.random.default_rng(seed)
    count = 40 if size < 100_000 else 4
    wraps = {"first": 2**32 - 20, "place": 2**48 // size * size - 13 * size}
    first = spoiled(packets_of(random_frames(count, size), **wraps), reorder=2 * seed)
    second = packets_of(random_frames(9, size, seed=1), first=7_000, place=10_000_000)
    again = packets_of(random_frames(count, size, seed=2))
    again = spoiled(again, loss=0.02 * seed, duplicate=0.01 * seed, seed=seed)
    mixed = [*first, *again]
    for place, one in zip(sorted(rng.integers(0, len(mixed), 9)), second, strict=False):
        mixed[place:place] = [one] if seed % 2 else []
    mixed.insert(len(mixed) // 2, b"x" * 2000)
    frames, counts = assemble(mixed, size)

    found = []
    assembler = Assembler(size, found.append)
    while mixed:
        stop = int(rng.integers(1, 65))
        some, mixed = mixed[:stop], mixed[stop:]
        rows = np.zeros((len(some), 2048), np.uint8)
        for row, one in zip(rows, some, strict=True):
            row[: len(one)] = np.frombuffer(one, np.uint8)
        assembler.add_all(rows, np.array([len(one) for one in some]))
    assembler.flush()
    assert assembler.counts == counts and added_up(counts)
    assert [f.number for f in found] == [f.number for f in frames]
    assert [f.lost_bytes for f in found] == [f.lost_bytes for f in frames]
    for one, other in zip(found, frames, strict=True):
        np.testing.assert_array_equal(one.data, other.data)
