"""Settings that every test needs before anything imports MuJoCo."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")
