"""`embodiedreamer policy predict`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.errors import PolicyError


@o.verb(
    o.option(
        "--scores", "FILE.csv", "policies with their scores in simulation and on the real robot", o.REQUIRED, Path
    ),
    o.option(
        "--evaluation", "FILE.json", "result of `policy evaluate --json` of another policy, to be predicted", None, Path
    ),
    o.SEED,
    o.JSON,
    o.QUIET,
)
def run(a, progress):
    """Predict a policy's success rate on the real robot from simulation, with the scores of other policies as evidence."""
    from embodiedreamer_gym.policies.prediction import read_scores

    progress("predicting")
    evidence = read_scores(a.scores)
    agreement = evidence.agreement(a.seed)
    if a.evaluation is None:
        return o.Result(agreement, agreement.as_dict())
    prediction = evidence.predict(*_counts(a.evaluation), a.seed)
    return o.Result(
        f"{prediction}\n{agreement}", {"prediction": prediction.as_dict(), "agreement": agreement.as_dict()}
    )


def _counts(path: Path) -> tuple[int, int]:
    """Successes and trials of an evaluation.

    Raises: PolicyError for another file.
    """
    from embodiedreamer_gym.io.files import read_json

    data = read_json(path, PolicyError, "evaluation")
    found = data if isinstance(data, dict) else {}
    successes, trials = found.get("successes"), found.get("trials")
    if type(successes) is not int or type(trials) is not int or not 0 <= successes <= trials or trials < 1:
        raise PolicyError(f"{path} is not a result of `policy evaluate --json`: it has no successes and trials.")
    return successes, trials
