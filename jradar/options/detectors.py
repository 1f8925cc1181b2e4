"""CFAR detectors by name, the window of their cells, and the rules at its ends.

`jradar.radar.detect.cfar` shows the window and explains each rule.
"""

from typing import NamedTuple

KINDS = {
    "ca": "cell averaging",
    "go": "greatest of",
    "so": "smallest of",
    "os": "ordered statistic",
}
EDGES = ("shrink", "one_sided", "fill", "reflect", "wrap", "skip")
GUARD, TRAIN = (2, 2), (4, 4)  # cells on a side in (doppler, range)


class Window(NamedTuple):
    """Cells on a side in (doppler, range), and the rule at the ends of the range."""

    guard: tuple[int, int]
    train: tuple[int, int]
    edge: str

    @property
    def sides(self) -> tuple[int, int]:
        """All cells on a side in (doppler, range)."""
        return self.guard[0] + self.train[0], self.guard[1] + self.train[1]


def largest_window(
    shape: tuple[int, ...], guard: tuple[int, int], train: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return `guard` and `train` shrunk until they fit into a map [doppler, range]."""
    doppler, range_ = ((bins - 1) // 2 for bins in shape[-2:])
    train = (min(train[0], doppler), min(train[1], range_))
    guard = (min(guard[0], doppler - train[0]), min(guard[1], range_ - train[1]))
    return guard, train


def check_window(window: Window, kind: str) -> None:
    """Raise ValueError for cells, a kind or an edge that no window has."""
    guard, train, edge = window
    for name, cells in (("guard", guard), ("train", train)):
        pair = isinstance(cells, tuple | list) and len(cells) == 2
        if not (pair and all(type(n) is int and n >= 0 for n in cells)):
            raise ValueError(
                f"{name} = {cells!r}, expected two whole numbers of 0 or more: cells "
                "in Doppler and in range"
            )
    if kind not in KINDS:
        raise ValueError(f"detector = {kind!r}, expected one of {tuple(KINDS)}")
    if edge not in EDGES:
        raise ValueError(f"edge = {edge!r}, expected one of {EDGES}")
    if edge == "fill" and (train[0] or kind in ("go", "so")):
        raise ValueError(
            f"CFAR edge='fill' with {kind=}, {train=}: expected ca or os along range "
            "only, train = (0, cells)"
        )
