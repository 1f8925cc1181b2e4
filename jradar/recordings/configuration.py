"""What a radar's configuration can measure, before anything is recorded.

The limits are those of TI's chips in the demo of the mmWave SDK, and of the DCA1000.
The demo keeps one frame in the chip's memory even if it only sends the samples.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from jradar.files import read_json
from jradar.options.models import shipped_models
from jradar.options.sensor import RadarSpec
from jradar.options.suiting import unsuited
from jradar.recordings.describe import describe_radar
from jradar.recordings.descriptions import read_description
from jradar.recordings.ti import lanes
from jradar.recordings.ti.dca1000 import bytes_of_frame

MOST_DUTY = 50.0  # % of the time in which a transmitter is on
MOST_BANDWIDTH_GHZ = 4.0
MOST_FRAME_KIB = 768.0  # 2**14 samples of 3 x 4 antennas, 4 bytes each
PACKET_BYTES, PACKET_S = 1456, 12.1e-6  # samples in a packet of the card; its time
SHORTEST_DELAY_S = 5e-6  # between two packets


class Check(NamedTuple):
    """One number of a configuration next to what the board allows."""

    check: str
    value: float
    most: float

    @property
    def fits(self) -> bool:
        """Whether the board allows it."""
        return self.value <= self.most * (1 + 1e-4)  # files round slopes


def describe_configuration(
    path: Path | str, *, device: str | None = None
) -> dict[str, Any]:
    """Return what a radar measures, and whether board and models suit it.

    "models" lists, for each shipped model, how the radar differs from those of its
    training.
    """
    found = read_description(path, device=device)
    radar, checks = found.radar, [*board_checks(found.radar)]
    failed = [check.check for check in checks if not check.fits]
    return {
        "configuration": str(path),
        "radar": describe_radar(radar),
        "frames/s": 1 / radar.frame_period_s if radar.frame_period_s else None,
        "models": {
            name: why
            for name, folder in shipped_models().items()
            if (why := _unsuited(folder, radar))
        },
        "the board can run it": f"no: {', '.join(failed)}" if failed else "yes",
        "limits": [check._asdict() | {"fits": check.fits} for check in checks],
        "notes": [*found.notes, *_hints(radar), *lanes.warnings(*found[:2])],
    }


def board_checks(radar: RadarSpec) -> Iterator[Check]:
    """Yield the limits of board and card; without a period, those that are known."""
    chirps = radar.num_tx * radar.num_chirps
    sweep_hz = radar.slope_hz_per_s * radar.ramp_end_time_s
    end_ghz = (radar.start_frequency_hz + sweep_hz) / 1e9
    yield Check("bandwidth (GHz)", sweep_hz / 1e9, MOST_BANDWIDTH_GHZ)
    yield Check("end of the ramp (GHz)", end_ghz, 64.0 if end_ghz < 70 else 81.0)
    if not radar.real_samples:  # for real ones, the memory is unknown
        yield Check(
            "frame in memory (KiB)", bytes_of_frame(radar) / 1024, MOST_FRAME_KIB
        )
    if period_s := radar.frame_period_s:
        busy_s = chirps * (radar.idle_time_s + radar.ramp_end_time_s)
        sending_s = chirps * radar.ramp_end_time_s
        yield Check("chirps in the period (%)", 100 * busy_s / period_s, 100.0)
        yield Check("duty cycle (%)", 100 * sending_s / period_s, MOST_DUTY)
        yield Check("link (Mbit/s)", link_mbps(radar), _card_mbps(SHORTEST_DELAY_S))


def link_mbps(radar: RadarSpec) -> float:
    """Return the megabits of samples in a second, at the radar's frame period."""
    return 8e-6 * bytes_of_frame(radar) / radar.frame_period_s


def _card_mbps(delay_s: float) -> float:
    """Return the megabits a second that the card sends with a pause between packets."""
    return 8e-6 * PACKET_BYTES / (delay_s + PACKET_S)


def _hints(radar: RadarSpec) -> Iterator[str]:
    """Yield what a user should set."""
    if radar.frame_period_s and link_mbps(radar) > _card_mbps(25e-6):
        delay_s = 8e-6 * PACKET_BYTES / link_mbps(radar) - PACKET_S
        if delay_s >= SHORTEST_DELAY_S:
            yield f"the link needs a --packet-delay of {1e6 * delay_s:.0f} us or less"


def _unsuited(model: Path, radar: RadarSpec) -> str:
    """Return why a shipped model may not suit a radar; its weights are not read.

    "" for a model that was trained on no radar's frames.
    """
    values = read_json(model / "model.json")
    trained = [RadarSpec.from_dict(seen) for seen in values["card"]["radars"]]
    if not trained:
        return ""
    found = unsuited(values["grid"]["kind"], trained, radar)
    return "; ".join(found) or "trained on such radars"
