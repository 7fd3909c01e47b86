"""What the program can do, frozen: drawn and real recordings, tables, lines, arrays.

One thread for linear algebra: cases run side by side, and threads that wait for each
other would cost many times what they compute.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
