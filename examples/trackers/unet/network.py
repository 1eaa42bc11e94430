"""Definitions shared by training and tracking."""

LOW, HIGH = -80.0, 20.0  # range of depths of the network, um
OFFSET_PX = 4.0  # largest offset from a pixel to a particle


def scaled(counts, asinh):
    """Counts as the network sees them; `asinh` is that of NumPy or PyTorch."""
    return asinh((counts - 350.0) / 50.0) / 3.0
