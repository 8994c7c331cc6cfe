from __future__ import annotations

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.progress import silent
from embodiedreamer_gym.phys_aligner import Problem, calibrate
from embodiedreamer_gym.phys_aligner.annealing import anneal
from embodiedreamer_gym.phys_aligner.search_range import SearchRange, cost
from embodiedreamer_gym.phys_aligner.searches import SEARCHES
from embodiedreamer_gym.phys_aligner.surrogate import recorded_steps, step_from

SHORT = {  # enough to lower the cost, no more
    "surrogate": {"epochs": 20, "steps": 1500},
    "surrogate-trajectory": {},
    "annealing": {"steps": 25},
    "annealing-scaled": {"steps": 30},
    "cma-es": {"budget": 60},
}
MOST = {"surrogate": 50, "surrogate-trajectory": 150, "annealing": 40, "annealing-scaled": 40, "cma-es": 60}


@pytest.fixture(scope="module")
def log(record):
    return record(1, seconds=2.0)


@pytest.mark.parametrize("method", SEARCHES)
def test_a_search_lowers_the_cost_and_is_repeatable(method: str, start, log) -> None:
    results, calls = [], []
    numpy_state, torch_state = np.random.get_state()[1].copy(), torch.get_rng_state()  # noqa: NPY002
    for _ in range(2):
        problem = Problem(start, [log])
        rng = np.random.default_rng(3)
        results.append(SEARCHES[method](problem, rng, progress=lambda *a, **k: calls.append(a), **SHORT[method]))
        assert 0 < problem.rollouts <= MOST[method]
    assert np.array_equal(*results)
    assert np.array_equal(numpy_state, np.random.get_state()[1])  # noqa: NPY002
    assert torch.equal(torch_state, torch.get_rng_state())
    before, after = cost(problem, np.stack([problem.start, results[0]]))
    assert after < 0.9 * before
    assert np.all((results[0] >= problem.lower) & (results[0] <= problem.upper))
    stage, done, total = calls[-1]
    assert isinstance(stage, str) and 0 <= done <= total


def test_calibrate_runs_a_search(start, log) -> None:
    found = calibrate(start, [log], method="cma-es", rng=np.random.default_rng(0), budget=40)
    assert found.method == "cma-es" and found.rollouts <= 40
    assert found.error == pytest.approx(float(cost(found.problem, found.problem.scale(
        np.array([found.model.parameters()[row.name].value for row in found.problem.rows])))[0]))  # fmt: skip


def test_the_trajectory_surrogate_reaches_least_squares_with_fewer_rollouts(start, log) -> None:
    squares = calibrate(start, [log])
    surrogate = calibrate(start, [log], method="surrogate-trajectory")
    assert surrogate.rollouts <= squares.rollouts
    assert surrogate.error == pytest.approx(squares.error, rel=1e-3)
    for row in squares.model.parameters().select("stiffness", "damping"):
        assert surrogate.model.parameters()[row.name].value == pytest.approx(row.value, rel=0.01)


def test_the_papers_surrogate_learns_from_free_runs_too(start, log) -> None:
    problem = Problem(start, [log])
    options = {"samples": 8, "epochs": 2, "steps": 50, "data": "simulated"}
    x = SEARCHES["surrogate"](problem, np.random.default_rng(3), **options)
    assert problem.rollouts == options["samples"] and np.all(np.isfinite(x))


@pytest.mark.parametrize("rule", ["linear", "hold"])
def test_one_step_from_a_recorded_state_is_a_step_of_the_free_run(rule: str, truth, record) -> None:
    log = record(1, noise=0.0, rule=rule, declared=rule, seconds=2.0)
    velocity = np.gradient(log.position, log.time, axis=0)
    problem = Problem(truth, [log.with_(velocity=velocity)])
    steps = recorded_steps(problem)
    ahead = step_from(problem, problem.start[None], steps)[0]
    moved = np.abs(steps.after - steps.state[:, :2])
    assert np.sqrt(np.mean((ahead - steps.after) ** 2)) < 0.06 * np.sqrt(np.mean(moved**2))


def test_simpler_envs_temperature_accepts_nearly_everything(start, log) -> None:
    _, hot = anneal(Problem(start, [log]), np.random.default_rng(0), silent, 60, 1.5, 1.0)
    _, cold = anneal(Problem(start, [log]), np.random.default_rng(0), silent, 40, 0.02, 0.15, scaled=True)
    assert hot > 0.85 > 0.7 > cold


def test_the_range_is_a_factor_around_the_start(start, log) -> None:
    problem = Problem(start, [log])
    box = SearchRange(problem, 3.0)
    values = [problem.values(box.x(u)) for u in (np.zeros(6), box.start, np.ones(6))]
    assert np.allclose(values[1], problem.values(problem.start))
    assert np.allclose(values[0] * 3, values[1]) and np.allclose(values[2], values[1] * 3)


def test_what_starts_at_zero_is_looked_for_around_it(start, log) -> None:
    off = start.with_values({"coulomb_friction.torque": {"shoulder": 0.0, "elbow": 0.0}})
    problem = Problem(off, [log])
    box = SearchRange(problem)
    friction = slice(4, 6)
    assert np.all(box.x(np.zeros(6))[friction] == 0.0)  # its lower bound
    assert np.allclose(box.x(np.ones(6))[friction], 1.0)
    assert np.allclose(box.x(box.start), problem.start)


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("surrogate", {"data": "guessed"}),
        ("surrogate", {"samples": 1}),
        ("surrogate-trajectory", {"budget": 10}),
        ("annealing", {"steps": 1}),
        ("annealing-scaled", {"factor": 1.0}),
        ("cma-es", {"budget": 3}),
    ],
)
def test_impossible_options_are_errors(method: str, options: dict, start, log) -> None:
    with pytest.raises(CalibrationError):
        SEARCHES[method](Problem(start, [log]), np.random.default_rng(0), **options)
