"""Protocol: the bytes of TI's guide; damaged messages are refused."""

import pytest

from jradar.errors import UsageError
from jradar.stream.protocol import (
    Command,
    NetworkSpec,
    configuration,
    pack_command,
    pack_packet,
    pack_reply,
    packet_delay,
    unpack_command,
    unpack_header,
    unpack_reply,
)
from tests.stream.packets import packet


def test_commands_are_the_bytes_of_the_guide():
    assert pack_command(Command.CONNECT) == bytes.fromhex("5aa509000000aaee")
    sent = pack_command(Command.CONFIGURE, configuration(lanes=2))
    assert sent == bytes.fromhex("5aa5030006000102010203 1eaaee")
    delay = pack_command(Command.PACKETS, packet_delay(25.0))
    assert delay == bytes.fromhex("5aa50b000600be05350c0000aaee")
    assert pack_reply(Command.START, 0) == bytes.fromhex("5aa505000000aaee")
    assert unpack_command(sent) == (Command.CONFIGURE, configuration(lanes=2))
    assert unpack_reply(pack_reply(Command.STOP, 1)) == (Command.STOP, 1)


@pytest.mark.parametrize("place", [0, 1456, 2**32 - 1, 2**32 + 5, 2**48 - 1])
def test_packets_hold_both_counters(place):
    for sequence in (1, 2**32 - 1):
        assert pack_packet(sequence, place, b"ab") == packet(sequence, place, b"ab")
        assert unpack_header(packet(sequence, place, b"ab")) == (sequence, place)
    assert pack_packet(2**32 + 7, 2**48 + 9, b"") == packet(7, 9, b"")


@pytest.mark.parametrize("raw", [b"", b"x" * 8, bytes.fromhex("5aa509000100aaee")])
def test_damaged_messages_are_refused(raw):
    with pytest.raises(ValueError, match="is not a card.s command"):
        unpack_command(raw)
    with pytest.raises(ValueError, match="is not a card.s reply"):
        unpack_reply(raw[:7])


def test_values_outside_the_cards_limits_are_refused():
    with pytest.raises(UsageError, match="expected 5 to 500"):
        packet_delay(1.0)
    with pytest.raises(UsageError, match="command_port = 70000"):
        NetworkSpec(command_port=70000)
