"""A live radar: its packets become frames, and its frames become clouds.

    DCA1000 ---UDP--> Receiver -> Assembler -> newest frame -> Processor -> writers
    Emulator --^

    NetworkSpec, Card           `protocol`, `card`: addresses; commands to the card
    Receiver                    `receiver`, `assembler`: makes frames of packets
    Emulator, FaultSpec         `emulator`: a card that plays a recording
    send_cfg                    `board`: the .cfg over the board's serial port
    Processor                   `processing`: makes clouds and a picture of a frame
    run_session, run_live       `live`: a whole session; its loop alone
    replaying, run_replay       an emulated card that plays a recording to its end

README.md has the wiring, the network's settings and what to check.
"""

from jradar.stream.card import Card as Card
from jradar.stream.emulator import (
    Emulator as Emulator,
    FaultSpec as FaultSpec,
    replaying as replaying,
)
from jradar.stream.live import (
    run_live as run_live,
    run_replay as run_replay,
    run_session as run_session,
    summary as summary,
)
from jradar.stream.processing import (
    Processor as Processor,
    frame_bytes as frame_bytes,
    quickest as quickest,
    radar_on_the_cable as radar_on_the_cable,
)
from jradar.stream.protocol import NetworkSpec as NetworkSpec
from jradar.stream.receiver import Receiver as Receiver
from jradar.stream.sockets import loopback_network as loopback_network
