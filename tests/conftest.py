"""One thread for BLAS: tests run side by side, and its threads wait for each other on matrices of 4 x 4."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read where NumPy and SciPy are first imported
