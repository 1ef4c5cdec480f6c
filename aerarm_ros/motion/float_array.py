"""The arrays that motions are made of."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
