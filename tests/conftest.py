"""Settings that every test needs before anything imports MuJoCo."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")
# One thread each, as workers have it: more only fight over the cores with tiny products.
os.environ.setdefault("OMP_NUM_THREADS", "1")
