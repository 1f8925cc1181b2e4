"""The models that come with the package, by name, each with its purpose."""

from pathlib import Path

MODELS = {
    "jradar-sim": "a dense cloud in one pass, of a radar that measures elevation",
    "jradar-sim-diffusion": "the same by the paper's diffusion, which is slower",
    "radarhd": "a cloud in the plane of one row of antennas",
    "radarhd-history": "the same from a frame and those before it",
    "radarhd-nearness": "the same, trained on nearness to the truth",
    "jradar-maps": "a map of voxels from a walk",
}
DEFAULT, DEFAULT_OF_MAPS = "jradar-sim", "jradar-maps"
WEIGHTS = Path(__file__).parents[1] / "weights"  # holds a folder for each


def shipped_models() -> dict[str, Path]:
    """Return the folders of the models that come with the package, by name."""
    found = sorted(path.parent for path in WEIGHTS.glob("*/model.json"))
    return {folder.name: folder for folder in found}


def absolute_model(name: Path | str) -> str:
    """Return a model's folder as an absolute path, and a shipped model's name as it is.

    Both name the same model in a process that runs in another folder.
    """
    shipped = str(name) in shipped_models()
    return str(name) if shipped else str(Path(name).absolute())
