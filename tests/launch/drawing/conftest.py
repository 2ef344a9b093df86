"""A recorded episode of a published agent with two subgoal layers."""

import pytest

import hac_suite
from launch.folder import policies
from launch.pictures import course as course_lib
from launch.pictures.course import Course

TASK, SEED = "pick_place", 11


@pytest.fixture(scope="session")
def course() -> Course:
    (path,) = [f.path for f in policies.published(TASK) if f.subgoal_layers == 2]
    return course_lib.record(hac_suite.Policy.load(path), SEED)
