"""What every registered task must satisfy."""

import dm_env
import numpy as np
import pytest
from absl.testing import absltest
from dm_control import composer
from dm_env import test_utils

import tasks
from analysis.reading import paper
from tasks import base, markers
from tasks.authoring import check
from tests.cases import some_slow
from tests.tasks import scripted

# Composer compiles each task anew to draw it: two of them stand for the others.
_DRAWN = pytest.mark.parametrize(
    "name", some_slow(tasks.ALL, *set(tasks.ALL) - {"pick_place", "pendulum_climb"})
)
_EVERY_TASK = pytest.mark.parametrize("name", tasks.ALL)


def _random_actions(environment, count, seed=0):
    spec, random_state = environment.action_spec(), np.random.RandomState(seed)
    return random_state.uniform(spec.minimum, spec.maximum, size=(count, *spec.shape))


def _flatten(timestep):
    return np.concatenate([np.ravel(part) for part in timestep.observation.values()])


def _states(environment, actions, each_step=lambda t: None):
    """The simulation's whole state after each action, [T, S]; `each_step` may meddle."""
    environment.reset()
    states = []
    for t, action in enumerate(actions):
        each_step(t)
        environment.step(action)
        data = environment.physics.data
        states.append(np.concatenate([data.qpos, data.qvel, data.sensordata, data.qacc_warmstart]))
    return np.array(states)


@_EVERY_TASK
def test_specs(name):
    environment = tasks.load(name, seed=1)
    task = environment.task
    assert isinstance(task, base.GoalTask)
    spec = environment.observation_spec()
    timestep = environment.reset()
    assert list(spec) == list(timestep.observation)
    for key, part in timestep.observation.items():
        spec[key].validate(part)
        assert np.isfinite(part).all(), key


@_EVERY_TASK
def test_what_the_spec_says_is_what_was_compiled(name):
    spec, environment = tasks.spec(name), tasks.load(name, seed=1)
    task, actions, model = environment.task, environment.action_spec(), environment.physics.model
    assert tasks.find(name).spec is spec is task.spec
    assert environment.control_timestep() == spec.control_timestep
    steps = spec.control_timestep / model.opt.timestep
    assert steps == pytest.approx(round(steps)) and round(steps) >= 1
    np.testing.assert_array_equal(spec.action_low, actions.minimum)
    np.testing.assert_array_equal(spec.action_high, actions.maximum)
    observation = environment.reset().observation
    points = ("achieved_goal", "achieved_subgoal", "desired_goal")
    assert list(observation) == [*spec.observation, *points]
    for part, scale in spec.observation.items():
        assert observation[part].shape == (len(scale),)
    readings = task.readings(environment.physics)
    np.testing.assert_array_equal(spec.flat(observation), task.observation(readings))
    assert len(spec.observation_names) == len(set(spec.observation_names)) == spec.observation_dim
    assert observation["achieved_goal"].shape == (spec.goal_space.dim,)
    assert observation["achieved_subgoal"].shape == (spec.subgoal_space.dim,)
    # Reports, films, replays and the live page describe a task in one wording.
    assert spec.title == paper.ABOUT[name]
    env = tasks.load_vector(name, 1)
    for field in ("max_steps", "control_timestep", "goal_space", "subgoal_space", "horizons"):
        assert getattr(env, field) is getattr(spec, field), field
    assert env.observation_dim == spec.observation_dim


@pytest.mark.slow
@_EVERY_TASK
def test_what_check_task_looks_for_is_good(name):
    found = list(check.findings(tasks.find(name)))
    assert len(found) >= 8
    assert [finding for finding in found if finding.verdict != "good"] == []


@_EVERY_TASK
def test_vector_sizes(name):
    env = tasks.load_vector(name, 5)
    step = env.reset()
    assert step.observation.shape == (5, env.observation_dim)
    assert step.achieved_goal.shape == step.desired_goal.shape == (5, env.goal_space.dim)
    assert step.achieved_subgoal.shape == (5, env.subgoal_space.dim)
    assert env.observation_scale.shape == (env.observation_dim,)
    assert (env.observation_scale > 0).all()
    assert env.name == name and env.num_envs == 5 and env.max_steps > 0
    assert env.action_low.shape == env.action_high.shape
    assert {array.dtype for array in step[:-1]} == {np.dtype(np.float64)}
    assert step.diverged.dtype == bool


@_EVERY_TASK
def test_observations_are_scaled_to_about_one(name):
    """Random actions keep the scaled observation within a few units, and use most of them."""
    env = tasks.load_vector(name, 16)
    step = env.reset(np.arange(16))
    random_state = np.random.RandomState(0)
    seen = []
    for _ in range(20):
        actions = random_state.uniform(env.action_low, env.action_high, (16, env.action_low.size))
        for _ in range(8):
            step = env.step(actions)
            seen.append(step.observation / env.observation_scale)
    largest = np.abs(seen).max(axis=(0, 1))
    assert (largest > 0.1).all(), largest
    assert np.quantile(np.abs(seen), 0.99) < 3.0


@_EVERY_TASK
def test_starts_and_goals_lie_in_their_spaces(name):
    env = tasks.load_vector(name, 64)
    for test in (False, True):
        step = env.reset(np.arange(64), test=test)
        assert (np.abs(env.goal_space.normalise(step.desired_goal)) <= 1.0).all()
        # Goals are inside; starts may stick out a little, as a rod held at a tilt does.
        assert (np.abs(env.goal_space.normalise(step.achieved_goal)) <= 1.1).all()
        assert (np.abs(env.subgoal_space.normalise(step.achieved_subgoal)) <= 1.1).all()
        assert not env.goal_space.achieved(step.achieved_goal, step.desired_goal).any() or not test


@_EVERY_TASK
def test_a_seed_decides_everything(name):
    actions = _random_actions(tasks.load(name, seed=0), 20)
    trajectories = []
    for seed in (5, 5, 6):
        environment = tasks.load(name, seed=seed)
        timesteps = [environment.reset(), *(environment.step(action) for action in actions)]
        trajectories.append(np.array([_flatten(timestep) for timestep in timesteps]))
    np.testing.assert_array_equal(trajectories[0], trajectories[1])
    assert (trajectories[0] != trajectories[2]).any()


@_EVERY_TASK
@pytest.mark.parametrize("test", [False, True])
def test_starts_are_random(name, test):
    env = tasks.load_vector(name, 16)
    observation = env.reset(np.arange(16), test=test).observation
    assert len(np.unique(observation, axis=0)) == 16
    environment = tasks.load(name, seed=0, test=test)
    assert (_flatten(environment.reset()) != _flatten(environment.reset())).any()


@_EVERY_TASK
def test_training_starts_are_wider_than_test_starts(name):
    env = tasks.load_vector(name, 256)
    training = env.reset(np.arange(256)).observation / env.observation_scale
    test = env.reset(np.arange(256), test=True).observation / env.observation_scale
    assert training.std(axis=0).sum() > test.std(axis=0).sum()


@_EVERY_TASK
def test_observations_share_no_memory(name):
    environment = tasks.load(name, seed=2)
    timesteps = [environment.reset()]
    timesteps += [environment.step(action) for action in _random_actions(environment, 2)]
    arrays = [part for timestep in timesteps for part in timestep.observation.values()]
    for i, one in enumerate(arrays):
        assert not any(np.shares_memory(one, other) for other in arrays[i + 1 :])


@_EVERY_TASK
def test_reward_is_minus_one_and_the_horizon_truncates(name):
    environment = tasks.load(name, seed=3, test=True)
    environment.reset()
    motionless = np.zeros(environment.action_spec().shape)
    for t in range(1, environment.task.spec.max_steps + 1):
        timestep = environment.step(motionless)
        assert (timestep.reward, timestep.discount) == (-1.0, 1.0)
        assert timestep.last() == (t == environment.task.spec.max_steps)
    assert environment.step(motionless).first()


@_EVERY_TASK
def test_success_ends_the_episode_with_reward_and_discount_zero(name):
    environment = tasks.load(name, seed=3)
    environment.reset()
    action = np.zeros(environment.action_spec().shape)
    probe = tasks.load(name, seed=3)
    probe.reset()
    environment.task._goal[:] = probe.step(action).observation["achieved_goal"]
    timestep = environment.step(action)
    assert timestep.step_type is dm_env.StepType.LAST
    assert (timestep.reward, timestep.discount) == (0.0, 0.0)


@_EVERY_TASK
def test_markers_have_no_effect_on_the_trajectory(name):
    """Markers that jump about, in the bodies' midst, change no bit of the state."""
    hidden, shown = tasks.load(name, seed=6), tasks.load(name, seed=6)
    actions = _random_actions(hidden, 60)
    random_state = np.random.RandomState(1)
    space = shown.task.spec.subgoal_space

    def show(t):
        subgoals = [
            random_state.uniform(space.low, space.high) for _ in range(markers.SUBGOAL_LEVELS)
        ]
        subgoals[0] = shown.task.achieved_subgoal(shown.task.readings(shown.physics))
        shown.task.place_subgoal_markers(shown.physics, subgoals)
        shown.task.place_goal_marker(
            shown.physics, shown.task.achieved_goal(shown.task.readings(shown.physics))
        )

    np.testing.assert_array_equal(_states(hidden, actions), _states(shown, actions, show))


@_EVERY_TASK
def test_markers_are_only_seen(name):
    environment = tasks.load(name)
    model = environment.physics.model
    moving = np.flatnonzero(model.body_mocapid >= 0)
    assert len(moving) >= 1 + markers.SUBGOAL_LEVELS
    assert not model.body_mass[moving].any()
    on_markers = np.isin(model.geom_bodyid, moving)
    assert not model.geom_contype[on_markers].any()
    assert not model.geom_conaffinity[on_markers].any()


@pytest.mark.requires_gl
@_DRAWN
def test_markers_show_and_hide_in_their_colours(name):
    env = tasks.load_vector(name, 2)
    env.reset(np.array([1, 2]), test=True)
    space = env.subgoal_space
    subgoals = [space.denormalise(np.full(space.dim, value)) for value in (0.25, -0.25)]
    without = env.render(0, height=240, width=320)
    env.show_subgoals(0, subgoals)
    purple, green, both = (
        _render_with(env, shown) for shown in ([subgoals[0]], [None, subgoals[1]], subgoals)
    )
    assert not np.array_equal(purple, green)
    np.testing.assert_array_equal(_render_with(env, []), without)
    # Purple gains red and blue on green; green the reverse.
    assert _greenness(purple, without) < -10 < 10 < _greenness(green, without)
    assert (both != without).any(axis=-1).sum() > (purple != without).any(axis=-1).sum()


def _render_with(env, subgoals):
    env.show_subgoals(0, subgoals)
    return env.render(0, height=240, width=320)


def _greenness(image, without):
    """How much greener the pixels got that changed most, of 255."""
    change = image.astype(float) - without
    strongest = np.abs(change).sum(axis=-1)
    change = change[strongest >= 0.8 * strongest.max()]
    return (change[:, 1] - (change[:, 0] + change[:, 2]) / 2).mean()


@pytest.mark.requires_gl
@_DRAWN
def test_two_cameras_see_the_scene_and_rendering_disturbs_nothing(name):
    env, twin = tasks.load_vector(name, 2), tasks.load_vector(name, 2)
    assert env._model.ncam == 2
    env.reset(np.array([1, 2]))
    twin.reset(np.array([1, 2]))
    actions = np.tile(0.5 * env.action_high, (2, 1))
    pictures = []
    for camera in range(2):
        step, expected = env.step(actions), twin.step(actions)
        np.testing.assert_array_equal(step.observation, expected.observation)
        pictures.append(env.render(1, camera=camera, height=120, width=160))
    assert all(picture.shape == (120, 160, 3) for picture in pictures)
    assert all(picture.dtype == np.uint8 and picture.std() > 5 for picture in pictures)
    assert (pictures[0] != pictures[1]).any()
    assert not np.shares_memory(*pictures)
    assert (env.render(0, height=120, width=160) != pictures[0]).any()


@_EVERY_TASK
def test_the_goal_is_reachable(name):
    assert name in scripted.SOLUTIONS, f"give {name} a controller in tests/tasks/scripted.py"
    env = tasks.load_vector(name, 16)
    taken = scripted.steps_to_goal(env, scripted.SOLUTIONS[name], np.arange(16))
    assert np.isfinite(taken).all(), taken
    # max_steps leaves a learner room, as the paper's episodes do.
    assert 1.5 * np.median(taken) <= env.max_steps <= 6 * np.median(taken)


@_EVERY_TASK
def test_an_impossible_draw_ends_with_a_clear_error(name):
    task = tasks.find(name).factory()
    with pytest.raises(composer.EpisodeInitializationError, match=r"no valid start in .* attempts"):
        task.draw("start", lambda: 0, lambda value: False)


@_EVERY_TASK
def test_actions_that_are_not_finite_are_refused(name):
    environment = tasks.load(name, seed=0)
    environment.reset()
    action = np.zeros(environment.action_spec().shape)
    action[-1] = np.nan
    with pytest.raises(ValueError, match=f"action {action.size - 1} .* is nan"):
        environment.step(action)


def _dm_env_tests(name):
    """dm_env's own tests of an environment, as a unittest case for one task."""

    class DmEnvTest(test_utils.EnvironmentTestMixin, absltest.TestCase):
        def make_object_under_test(self):
            return tasks.load(name, seed=0)

    return DmEnvTest


@_EVERY_TASK
@pytest.mark.parametrize(
    "check", [check for check in dir(test_utils.EnvironmentTestMixin) if check.startswith("test_")]
)
def test_dm_env(name, check):
    case = _dm_env_tests(name)(check)
    result = case.run()
    problems = [text for _, text in result.errors + result.failures]
    assert not problems, problems[0]
    assert result.testsRun == 1
