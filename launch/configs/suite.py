"""The `suite` preset, the default: the same hyperparameters for all agents.

Each field is explained in hac_suite/config.py.
"""

from ml_collections import ConfigDict

from launch.asking import settings


def get_config() -> ConfigDict:
    return settings.from_preset("suite")
