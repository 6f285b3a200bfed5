"""One thread for linear algebra, set before numpy loads. Imported for that alone.

The matrices here are small: a second thread gains nothing on an idle machine, and on a busy one the two wait for each
other and take ten times as long. Whoever sets OMP_NUM_THREADS is left alone.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
