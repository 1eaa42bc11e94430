"""Definitions shared by training and tracking."""

AXIS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # elements of the tensor n n^T of an axis n, which has no sign

LOW, HIGH = -80.0, 20.0  # range of depths of the network, um
OFFSET_PX = 4.0  # largest offset from a pixel to a particle


def scaled(counts, asinh):
    """Counts as the network sees them; `asinh` is that of NumPy or PyTorch."""
    return asinh((counts - 350.0) / 50.0) / 3.0
