"""`embodiedreamer policy evaluate`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.pipelines.settings import EvaluationSettings

VIDEO = {"metavar": "DIR", "kind": o.output_folder}


@o.verb(*o.settings_options(EvaluationSettings, vis_aligner=o.VIS_ALIGNER, video=VIDEO), o.JSON, o.QUIET)
def run(a, progress):
    """Evaluate a policy on held-out seeds: success rate with its 95-percent interval, and one row per episode."""
    from embodiedreamer_gym.pipelines.policy_runs import play

    evaluation = play(o.settings_of(EvaluationSettings, a), progress)
    origin = {"policy": str(a.policy), "robot": str(a.robot), "vis_aligner": a.vis_aligner}
    return o.Result(evaluation, {**origin, **evaluation.as_dict()})
