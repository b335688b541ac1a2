"""Every test runs in float64."""

import os

# BLAS threads gain nothing on the solver's small blocks and spin on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)
