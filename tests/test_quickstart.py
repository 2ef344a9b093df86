"""docs/quickstart.md: its Python runs as it stands, but for the training, which is cut short."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch

import hac_suite
import tasks

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "quickstart.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
SHORT = {
    "episodes_per_period=60": "episodes_per_period=4, test_episodes=2",
    "periods=4": "periods=1",
}


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The names that the page's blocks leave behind, run one after the other; what they printed."""
    folder = tmp_path_factory.mktemp("quickstart")
    (folder / "assets").symlink_to(ROOT / "assets")
    threads = torch.get_num_threads()
    names, printed = {}, []
    names["print"] = lambda *words: printed.append(" ".join(map(str, words)))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in BLOCKS:
            exec(compile(shortened(block), "quickstart.md", "exec"), names)
    torch.set_num_threads(threads)
    return names, printed, folder


def shortened(block: str) -> str:
    if "hac_suite.train(" in block:
        for long, short in SHORT.items():
            assert block.count(long) == 1
            block = block.replace(long, short)
    return block


def test_the_policy_brings_the_rod_to_its_goal(ran):
    names, printed, _ = ran
    assert (
        names["env"]
        .goal_space.achieved(names["step"].achieved_goal, names["step"].desired_goal)
        .all()
    )
    assert printed[0].startswith("the rod is at [")


def test_the_first_action_on_composers_face_is_that_of_the_fast_one(ran):
    names, _, _ = ran
    policy, spec = names["policy"], tasks.spec("pick_place")
    start = tasks.load_vector("pick_place", 1).reset([0], test=True)
    policy.reset(spec)
    action = policy.act(start.observation[0], start.desired_goal[0], start.achieved_subgoal[0])
    np.testing.assert_array_equal(action, names["action"])
    assert (names["timestep"].reward, names["timestep"].discount) == (-1.0, 1.0)


def test_most_of_the_episodes_succeed(ran):
    assert ran[0]["episodes"].success.mean() >= 0.75


def test_training_tests_an_untrained_agent_and_then_a_trained_one(ran):
    names, printed, folder = ran
    assert [line[0] for line in printed if re.match(r"\d \[", line)] == ["0", "1"]
    assert [row["seed"] for row in names["result"].rows] == [0, 1]
    saved = hac_suite.Policy.load(folder / "pendulum_climb_seed0")
    assert saved.metadata["task"] == "pendulum_climb"
    saved.reset(tasks.spec("pendulum_climb"))
    assert abs(saved.act(np.array([0.0, 1.0, 0.0]), [0.0, 1.3], [0.0, 0.3])[0]) <= 2.0


def test_gymnasium_made_the_task(ran):
    assert ran[1][-1].endswith(" 300")
