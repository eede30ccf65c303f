"""How threads wait for each other; to be imported before torch, by programs rather than by the library.

OpenMP's threads spin at the end of each loop until the last one is there. On a busy machine, or one of
few cores, the spinning takes the time of the thread that is waited for: beside one busy program on two
cores a bake took ten times as long. Spinning briefly costs a few percent on an idle machine.
"""

import os

SPINS = "1000"  # turns before a thread goes to sleep

os.environ.setdefault("GOMP_SPINCOUNT", SPINS)
