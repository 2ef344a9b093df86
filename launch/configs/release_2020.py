"""The `release_2020` preset: the authors' public release of May 2020.

Each field is explained in hac_suite/config.py.
"""

from ml_collections import ConfigDict

from launch.asking import settings


def get_config() -> ConfigDict:
    return settings.from_preset("release_2020")
