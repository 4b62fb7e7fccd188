"""Solutions free of their solver's last bits, so that runs repeat to the bit."""

from __future__ import annotations

import numpy as np

from layered_cbf_ros.interfaces import Array


def rounded(values: Array, resolution: float) -> Array:
    """Return values as multiples of a resolution, of the same unit.

    A solver adds up in an order that depends on where its memory lies, and stops
    wherever its tolerance lets it: two solvers of the same problem may differ by
    1e-12, or by as much as the tolerance leaves open. The resolution has to be far
    coarser than that.
    """
    return resolution * np.rint(values / resolution)
