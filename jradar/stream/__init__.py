"""A live radar: its packets become frames, and its frames become clouds.

    DCA1000 ---UDP--> Receiver --> newest frame --> Processor --> writers
    Emulator --^                         ^
    board's data port --> PointsPort ----|          of a radar that sends points
    its recording ------> Player --------'

    Source                      `source`: what all sources of frames do
    NetworkSpec, Card           `protocol`, `card`: addresses; commands to the card
    Receiver                    `receiver`, `assembler`: makes frames of packets
    Emulator, FaultSpec         `emulator`: a card that plays a recording of samples
    Board, second_port          `board`: the .cfg over the board's first serial port
    PointsPort                  `points_port`: makes clouds of the second port's bytes
    Player                      `player`: plays a recording of points
    Processor                   `processing`: makes clouds and a picture of a frame
    run_session, card_runs, ..  `session`: a whole session; the devices that feed it
    run_live, summary           `live`: its loop alone; what happened to the frames

README.md has the wiring, the network's settings and what to check.
"""

from jradar.stream.board import Board as Board, second_port as second_port
from jradar.stream.card import Card as Card
from jradar.stream.emulator import (
    Emulator as Emulator,
    FaultSpec as FaultSpec,
    replaying as replaying,
)
from jradar.stream.live import run_live as run_live, summary as summary
from jradar.stream.player import Player as Player
from jradar.stream.points_port import (
    PointsPort as PointsPort,
    points_on_the_cable as points_on_the_cable,
)
from jradar.stream.processing import (
    Processor as Processor,
    frame_bytes as frame_bytes,
    quickest as quickest,
    radar_on_the_cable as radar_on_the_cable,
)
from jradar.stream.protocol import NetworkSpec as NetworkSpec
from jradar.stream.receiver import Receiver as Receiver
from jradar.stream.session import (
    board_runs as board_runs,
    card_runs as card_runs,
    emulator_runs as emulator_runs,
    played as played,
    run_replay as run_replay,
    run_session as run_session,
)
from jradar.stream.sockets import loopback_network as loopback_network
from jradar.stream.source import Source as Source
