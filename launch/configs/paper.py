"""The `paper` preset: what the paper describes.

Each field is explained in hac_suite/config.py.
"""

from ml_collections import ConfigDict

from launch.asking import settings


def get_config() -> ConfigDict:
    return settings.from_preset("paper")
