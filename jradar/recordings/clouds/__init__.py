"""Point clouds in PLY, PCD, KITTI, CSV and NPZ files."""
