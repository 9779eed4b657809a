"""Array types of the matching."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.integer[Any] | np.floating[Any]]
"""Real values; single precision wherever pixels are concerned."""
Grey = NDArray[np.uint8]
"""(h, w) grey values of a picture."""
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
