"""Radar in a log of TI's mmWave Studio.

    API:ProfileConfig,0,1435384036,10000,600,6000,0,0,621,0,256,10000,0,0,30,0,

Each line holds a command and its arguments in register units. A repeated command
replaces the earlier one.
"""

from pathlib import Path

from jradar.radar import RadarSpec
from jradar.radar.devices import BOARDS
from jradar.recordings.text_files import radar_of, read_text

# Register units of mmWave Studio (TI mmWave Link interface control document).
FREQUENCY_HZ = 3.6e9 / 2**26
SLOPE_HZ_PER_S = 3.6e9 * 900 / 2**26 * 1e6
TIME_S = 10e-9
FRAME_PERIOD_S = 5e-9
NEEDED = (
    *("select_chip_version", "ChannelConfig", "AdcOutConfig", "ProfileConfig"),
    *("ChirpConfig", "FrameConfig"),
)
CHIPS = {board.studio_chip: board for board in BOARDS.values() if board.studio_chip}


def radar_from_studio_log(path: Path | str) -> RadarSpec:
    """Return the radar in the log that mmWave Studio writes beside `adc_data.bin`.

    Transmitters are in firing order, which is also their order in the recorded file.
    """
    commands: dict[str, list[str]] = {}
    tx_of_chirp: dict[int, list[int]] = {}
    for line in read_text(path).splitlines():
        name, _, rest = line.partition("API:")[2].partition(",")
        arguments = rest.rstrip(",").split(",")
        commands[name] = arguments
        if name == "ChirpConfig":
            first, last, *_ = map(int, arguments)
            on = [tx for tx, bit in enumerate(arguments[7:]) if int(bit)]
            tx_of_chirp |= dict.fromkeys(range(first, last + 1), on)
    if missing := ", ".join(name for name in NEEDED if name not in commands):
        raise ValueError(f"{path}: no {missing}: is it the log of mmWave Studio?")
    chip = commands["select_chip_version"][0]
    if chip not in CHIPS:
        raise ValueError(f"{path}: chip {chip}, expected one of {', '.join(CHIPS)}")
    board = CHIPS[chip]
    try:
        profile = [int(value) for value in commands["ProfileConfig"]]
        first, last, _, loops, period = map(int, commands["FrameConfig"][:5])
        rx_mask = int(commands["ChannelConfig"][1])
        is_complex = int(commands["AdcOutConfig"][1]) > 0
        fired = [tx_of_chirp[chirp] for chirp in range(first, last + 1)]
        idle, adc_start, ramp_end, slope = *profile[2:5], profile[7]
        num_samples, sample_rate_ksps = profile[9:11]
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path}: incomplete configuration ({error})") from error
    if not is_complex:
        raise ValueError(f"{path}: real samples were recorded, expected complex ones")
    fields = {
        "name": chip.lower(),
        "start_frequency_hz": profile[1] * FREQUENCY_HZ,
        "slope_hz_per_s": slope * SLOPE_HZ_PER_S,
        "sample_rate_hz": sample_rate_ksps * 1e3,
        "num_samples": num_samples,
        "num_chirps": loops,
        "idle_time_s": idle * TIME_S,
        "adc_start_time_s": adc_start * TIME_S,
        "ramp_end_time_s": ramp_end * TIME_S,
        "tx_positions": tuple(board.tx_positions[t] for t in one_tx_each(path, fired)),
        "rx_positions": tuple(
            place for bit, place in enumerate(board.rx_positions) if rx_mask >> bit & 1
        ),
        "design_frequency_hz": board.design_frequency_hz,
        "frame_period_s": period * FRAME_PERIOD_S,
    }
    return radar_of(path, fields)


def one_tx_each(path: Path | str, fired: list[list[int]]) -> list[int]:
    """Return the one transmitter of each chirp of a turn, given the lists of all."""
    order = [tx[0] for tx in fired if len(tx) == 1]
    if len(order) < len(fired) or len(set(order)) < len(order):
        raise ValueError(
            f"{path}: the chirps of a frame fire transmitters {fired}, expected each "
            "chirp to fire one, and each transmitter to fire once"
        )
    return order
