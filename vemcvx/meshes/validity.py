"""stub."""
import numpy as np
def checked(points, cells):
    points = np.array(points, dtype=float)
    counts = np.array([len(c) for c in cells])
    return points, np.concatenate([[0], np.cumsum(counts)]), np.concatenate([np.asarray(c) for c in cells]).astype(np.int64), None
