"""The candidate recipe: one rule for hindsight and critic, and less exploration above level 0.

Every transition of every level gets two hindsight goals from its future, and no critic goes below
the least return there can be. Without subgoal layers, the last three settings do nothing.

Each field is explained in hac_suite/config.py.
"""

from ml_collections import ConfigDict

from launch.asking import settings


def get_config() -> ConfigDict:
    config = settings.from_preset("paper")
    config.hindsight_relabels = "future"
    config.hindsight_goals = 2
    config.critic_floor = "returns"
    config.test_draw = "each_level"
    config.subgoal_noise = 0.03
    config.random_subgoal_rate = 0.1
    return config
