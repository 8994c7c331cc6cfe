"""Free runs: batches, irregular logs, commands between samples, first states, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.simulation import TIME_STEP, simulate, simulate_sets
from embodiedreamer_gym.simulation.rollout import command_rule, first_state, plant_commands
from tests.bank import BUILT_IN, fast, log, plain, robot


def rich(name: str):
    """A model with one effect of each stage and kind that acts at every step."""
    model = robot(name)
    chosen = ("command_delay", "command_lowpass", "coulomb_friction", "joint_spring", "payload", "encoder_offset")
    for effect in chosen:
        model = model.with_effect(plain(model, model.catalogue[effect], 0.5))
    return model


@pytest.mark.parametrize("name", BUILT_IN)
def test_recordings_of_different_lengths_in_one_batch_equal_single_runs(name: str) -> None:
    model = rich(name)
    recordings = [
        fast(model, 0.4, seed=1),
        fast(model, 1.7, rate=63.0, seed=2),
        fast(model, 1.05, rate=250.0, seed=3),
        fast(model, 0.4, seed=4),
    ]
    for run, recording in zip(simulate_sets(model, recordings), recordings, strict=True):
        alone = simulate(model, recording)
        for together, single in ((run.position, alone.position), (run.velocity, alone.velocity)):
            np.testing.assert_allclose(together[0], single, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(run.time, recording.time)


def test_the_same_run_twice_is_the_same_to_the_last_bit() -> None:
    model = rich("so101")
    a, b = (simulate(model, fast(model)) for _ in range(2))
    for name in ("position", "velocity", "torque"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_irregular_time_stamps_sample_one_and_the_same_motion() -> None:
    """A log with jittered stamps, and one that starts at another time, see the motion of the regular one."""
    model = robot("arm6")
    dense = fast(model, 2.0, rate=960.0)
    motion = simulate(model, dense)
    rng = np.random.default_rng(0)
    rows = np.unique(np.r_[:3, np.sort(rng.choice(len(dense.time), 250, replace=False))])
    thin = dense.with_(**{k: getattr(dense, k)[rows] for k in ("time", "position", "command", "usable")})
    held = log(model, dense.time[rows] + 100.0, dense.command[rows])
    run = simulate(model, held)
    np.testing.assert_allclose(run.time, thin.time + 100.0)
    # what differs is only that the command between the stamps is a line
    np.testing.assert_allclose(run.position, motion.position[rows], atol=8e-3)
    # exactly the same commands: a straight line is known from any two of its samples
    line = np.linspace(0, 0.5, len(dense.time))[:, None] * np.ones(6)
    a = simulate(model, log(model, dense.time, line, position=0 * line))
    b = simulate(model, log(model, dense.time[rows], line[rows], position=0 * line[rows]))
    np.testing.assert_allclose(b.position, a.position[rows], atol=1e-10)
    np.testing.assert_allclose(b.velocity, a.velocity[rows], atol=1e-9)


def test_a_sample_between_two_steps_lies_on_the_path() -> None:
    model = robot("arm6")
    dense = fast(model, 1.0, rate=2400.0)
    run = simulate(model, dense)
    speed = np.gradient(run.position, dense.time, axis=0)
    assert np.sqrt(np.mean((run.velocity - speed)[5:-5] ** 2)) < 2e-3
    steps = run.position[::10]
    np.testing.assert_allclose(steps, simulate(model, fast(model, 1.0, rate=240.0)).position, atol=2e-4)


@pytest.mark.parametrize("rate", [100.0, 30.0, 17.0])
def test_a_held_command_keeps_its_edges_in_time(rate: float) -> None:
    """Averaged over the step, a held command at 240 Hz does what it does at 4 kHz."""
    model = robot("arm6")
    recording = fast(model, 2.0, rate=rate)
    coarse = simulate(model, recording, hold="hold")
    fine = simulate(model, recording, dt=1 / 4000, hold="hold")
    linear = simulate(model, recording, hold="linear")
    assert 1e3 * np.sqrt(np.mean((linear.position - fine.position) ** 2)) > 3.0, "the rules differ"
    assert 1e3 * np.sqrt(np.mean((coarse.position - fine.position) ** 2)) < 0.25, "mrad"


def test_commands_on_the_plants_grid() -> None:
    model = robot("servo")
    time = np.arange(11) / 10
    recording = log(model, time, time[:, None])
    grid = np.arange(len(plant_commands(recording, "linear"))) * TIME_STEP
    np.testing.assert_allclose(plant_commands(recording, "linear")[:, 0], np.minimum(grid, 1.0))
    held = plant_commands(recording, "hold")[:, 0]
    inside = np.abs((grid * 10 + 0.5) % 1 - 0.5) > 10 * TIME_STEP  # no edge within half a step
    np.testing.assert_allclose(held[inside], np.minimum(np.floor(grid * 10) / 10, 1.0)[inside], atol=1e-9)
    steps = grid < 1.0 - TIME_STEP / 2  # they cover the time until half a step before the end
    area = 0.1 * np.sum(np.arange(10) / 10) - 0.9 * TIME_STEP / 2
    assert np.sum(held[steps]) * TIME_STEP == pytest.approx(area, abs=1e-9), "no area is lost"


@pytest.mark.parametrize(
    ("model_rule", "log_rule", "rule"),
    [("unknown", "unknown", "linear"), ("unknown", "hold", "hold"), ("linear", "hold", "linear")],
)
def test_whose_rule_counts_between_commands(model_rule: str, log_rule: str, rule: str) -> None:
    model = robot("arm6").with_(command_hold=model_rule)
    assert command_rule(model, fast(model).with_(command_hold=log_rule)) == rule


@pytest.mark.parametrize("rate", [30.0, 100.0, 1000.0])
def test_a_moving_start_is_read_from_the_first_50_ms(rate: float) -> None:
    model = robot("servo")
    time = np.arange(int(rate)) / rate
    path = (0.2 + 0.8 * time + 2.0 * time**2)[:, None]
    noise = 1e-4 * np.random.default_rng(0).standard_normal(path.shape)
    recording = log(model, time, path, path + noise).with_(noise=np.array([1e-4]))
    position, velocity = first_state(recording)
    assert position[0] == pytest.approx(0.2, abs=4e-4)
    assert velocity[0] == pytest.approx(0.8, abs=0.03)
    at_rest = log(model, time, path, 0.2 + noise).with_(noise=np.array([1e-4]))
    assert first_state(at_rest)[1][0] == 0.0


def test_another_robots_log_is_refused() -> None:
    model = robot("arm6")
    recording = fast(model)
    with pytest.raises(SimulationError, match=r"has 6 joints \(joint1.*but model aloha has 14"):
        simulate(robot("aloha"), recording)
    with pytest.raises(SimulationError, match="holds no command"):
        simulate(model, recording.with_(command=None))


def test_a_rollout_says_its_shape() -> None:
    model = robot("servo")
    assert repr(simulate(model, fast(model, 1.0))) == "Rollout(T=101, n=1)"
