"""Selection among candidates, shared by several trackers."""

import numpy as np


def strongest_within(points, strength, distance):
    """Indices of the points that have no stronger chosen point within `distance`."""
    chosen = []
    for index in np.argsort(-np.asarray(strength)):
        if all(np.hypot(*(points[index] - points[other])) >= distance for other in chosen):
            chosen.append(index)
    return sorted(chosen)
