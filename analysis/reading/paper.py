"""Values from the paper for comparison: task titles and efficient step counts."""

import pandas as pd

TITLES = {
    "pendulum_climb": "Pendulum - Climb",
    "pendulum_balance": "Pendulum - Balance",
    "ur5_reacher": "UR5 Reacher",
    "cartpole_swingup": "Cartpole Swingup",
    "pick_place": "1-Object Pick-and-Place",
}

ABOUT = {
    "pendulum_climb": "Swing up a pendulum until its tip touches the peak. Its motor is too weak "
    "to lift it at once, so it must swing to and fro first.",
    "pendulum_balance": "Swing up a pendulum and bring it to rest at the peak. Its motor is too "
    "weak to lift it at once, so it must swing to and fro first.",
    "ur5_reacher": "A UR5 arm must bring its gripper to a point a quarter turn away.",
    "cartpole_swingup": "A cart on a rail must swing up its pole and slow it down near a marker, "
    "with the cart below.",
    "pick_place": "A robot worm must pick up the blue rod and bring it to the yellow one.",
}
"""What each task asks for: the title of its spec, which the analysis may not import."""

STEPS_TO_GOAL = {
    "pendulum_climb": 100,
    "pendulum_balance": 150,
    "ur5_reacher": 60,
    "cartpole_swingup": 170,
    "pick_place": 110,
}
"""Actions that an efficient policy takes to reach the goal (section 4.1)."""


def title(task: str) -> str:
    """The task's name as in Figure 5; a task the paper lacks is named after itself."""
    return TITLES.get(task, task[:1].upper() + task[1:].replace("_", " "))


def in_order(table: pd.DataFrame) -> pd.DataFrame:
    """The rows with their tasks as Figure 5 has them; tasks that the paper lacks come last."""
    place = {task: index for index, task in enumerate(TITLES)}
    return table.sort_values("task", key=lambda tasks: tasks.map(place), kind="stable")


def agent_name(subgoal_layers: int) -> str:
    """The agent as the paper's legends call it: "1 subgoal layer"."""
    return f"{subgoal_layers} subgoal layer{'' if subgoal_layers == 1 else 's'}"
