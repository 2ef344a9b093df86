"""The `suite` preset, the default: one recipe for agents with and without subgoal layers.

Each field is explained in hac_suite/config.py.
"""

from ml_collections import ConfigDict

from launch.asking import settings


def get_config() -> ConfigDict:
    return settings.from_preset("suite")
