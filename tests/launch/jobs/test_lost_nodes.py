"""A node of a Ray cluster dies in mid-run: whole results, equal to one machine's, each once."""

import functools
import os
import re
import threading
import time
from pathlib import Path

# Before Ray is imported: the nodes are reached from this machine alone.
os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"

import pandas as pd
import pytest
import ray
from ray.cluster_utils import Cluster as TwoNodes

from analysis.reading import schema
from analysis.reading.results import load
from launch.folder.layout import RunFolder
from launch.jobs import worker
from tests.launch import launching

SMALL = (
    "--task=ur5_reacher", "--seeds=2", "--subgoal_layers=0,1", "--periods=6", "--novideo",
    "--config.episodes_per_period=24", "--config.episodes_per_round=8",
    "--config.test_episodes=4", "--config.updates_per_episode=4",
)  # fmt: skip


launch = functools.partial(launching.launch, work=worker.train_job)


def learnt(out: Path) -> tuple[pd.DataFrame, dict[str, bytes]]:
    """All of results.csv but the times, and the weights of every policy."""
    folder = out / "ur5_reacher"
    weights = {file.name: file.read_bytes() for file in folder.glob("policies/*.safetensors")}
    return load(folder).drop(columns=list(schema.CLOCKS)), weights


@pytest.fixture
def two_nodes():
    """A head without a core, and two nodes of one core each."""
    node = {"object_store_memory": 100 * 2**20, "include_dashboard": False}
    cluster = TwoNodes(initialize_head=True, head_node_args={"num_cpus": 0, **node})
    nodes = [cluster.add_node(num_cpus=1, **node) for _ in range(2)]
    yield cluster, nodes
    ray.shutdown()
    cluster.shutdown()


@pytest.mark.slow
def test_a_node_dies_in_mid_run_and_the_results_are_those_of_one_machine(
    tmp_path, two_nodes, capsys
):
    cluster, nodes = two_nodes
    (tmp_path / "ray").mkdir()
    checkpoints = RunFolder(tmp_path / "ray", "ur5_reacher").checkpoints
    doomed = nodes[1]

    def kill_once_checkpointed():
        while len(list(checkpoints.glob("*/*.json"))) < 6:  # of both jobs' seeds
            time.sleep(0.1)
        cluster.remove_node(doomed, allow_graceful=False)

    killer = threading.Thread(target=kill_once_checkpointed, daemon=True)
    killer.start()
    address = f"--ray_address={cluster.address}"
    assert launch(tmp_path / "ray", *SMALL, "--executor=ray", address) == 0
    killer.join(timeout=1)
    assert not killer.is_alive()
    printed = capsys.readouterr().out
    begun_again = re.search(
        r"lost with its machine .*resumes elsewhere from episode (\d+)", printed
    )
    assert begun_again and int(begun_again[1]) > 0, printed
    assert "\x1b" not in printed and "\r" not in printed  # also in what Ray itself says
    assert launch(tmp_path / "local", *SMALL, "--workers=2") == 0
    results, weights = learnt(tmp_path / "ray")
    expected_results, expected_weights = learnt(tmp_path / "local")
    pd.testing.assert_frame_equal(results, expected_results, check_exact=True)
    assert weights == expected_weights and len(weights) == 4
