"""Radar described by a log of TI's mmWave Studio."""

from pathlib import Path
from typing import Any

from jradar.radar import RadarSpec
from jradar.radar.devices import BOARDS
from jradar.recordings.text_files import radar_of, read_text

# Register units of mmWave Studio (TI mmWave Link interface control document).
FREQUENCY_HZ = 3.6e9 / 2**26
SLOPE_HZ_PER_S = 3.6e9 * 900 / 2**26 * 1e6
TIME_S = 10e-9
FRAME_PERIOD_S = 5e-9


def in_turn(path: Path | str, fired: list[list[int]]) -> list[int]:
    """The one transmitter of each chirp of a turn; `fired` lists all of a chirp."""
    order = [tx[0] for tx in fired if len(tx) == 1]
    if len(order) < len(fired) or len(set(order)) < len(order):
        raise ValueError(
            f"{path}: the chirps of a frame fire transmitters {fired}, expected each "
            "chirp to fire one, and each transmitter to fire once"
        )
    return order


def mmwave_studio_log(path: Path | str) -> dict[str, Any]:
    """Fields of the radar that a mmWave Studio log configured.

    A repeated command replaces the one before it. The transmitters are in the order in
    which the frame fires them, which is also their order in the recorded file.
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

    needed = ("select_chip_version", "ChannelConfig", "AdcOutConfig", "ProfileConfig")
    needed += ("ChirpConfig", "FrameConfig")
    if missing := [name for name in needed if name not in commands]:
        raise ValueError(
            f"{path}: no {', '.join(missing)}: is it the log of mmWave Studio?"
        )
    chip = commands["select_chip_version"][0]
    boards = {b.studio_chip: name for name, b in BOARDS.items() if b.studio_chip}
    if chip not in boards:
        raise ValueError(f"{path}: chip {chip}, expected one of {[*boards]}")
    try:
        profile = [int(value) for value in commands["ProfileConfig"]]
        frame = [int(value) for value in commands["FrameConfig"][:5]]
        first, last, _, loops, period = frame
        rx_mask = int(commands["ChannelConfig"][1])
        is_complex = int(commands["AdcOutConfig"][1]) > 0
        fired = [tx_of_chirp[chirp] for chirp in range(first, last + 1)]
        idle, adc_start, ramp_end, slope = *profile[2:5], profile[7]
        num_samples, sample_rate_ksps = profile[9:11]
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path}: incomplete configuration ({error})") from error
    if not is_complex:
        raise ValueError(f"{path}: real samples were recorded, expected complex ones")
    board = BOARDS[boards[chip]]
    return {
        "name": boards[chip],
        "start_frequency_hz": profile[1] * FREQUENCY_HZ,
        "slope_hz_per_s": slope * SLOPE_HZ_PER_S,
        "sample_rate_hz": sample_rate_ksps * 1e3,
        "num_samples": num_samples,
        "num_chirps": loops,
        "idle_time_s": idle * TIME_S,
        "adc_start_time_s": adc_start * TIME_S,
        "ramp_end_time_s": ramp_end * TIME_S,
        "tx_positions": tuple(board.tx_positions[tx] for tx in in_turn(path, fired)),
        "rx_positions": tuple(p for p in board.rx_positions if rx_mask >> p[0] & 1),
        "design_frequency_hz": board.design_frequency_hz,
        "frame_period_s": period * FRAME_PERIOD_S,
    }


def radar_from_studio_log(path: Path | str) -> RadarSpec:
    """The radar in the log that mmWave Studio writes beside `adc_data.bin`."""
    return radar_of(path, mmwave_studio_log(path))
