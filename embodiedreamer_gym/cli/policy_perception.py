"""`embodiedreamer policy perception`."""

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.option("--policy", "POLICY", "folder from `policy train`, or package.module:function", o.REQUIRED),
    o.TASK,
    o.option("--bank", "BANK", "bank of real photos with known joints and object poses: lab, or a file", "lab"),
    o.ROBOT,
    o.out_file("FILE.npz", "perception errors, for `policy evaluate` and `policy prefer`", None),
    o.QUIET,
    o.JSON,
)
def run(a, progress):
    """Measure how a policy's actions differ between real photos and generated pictures of the same scenes."""
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.pipelines.perception import measure_perception
    from embodiedreamer_gym.policies import load_policy

    errors = measure_perception(load_policy(a.policy), task_name(a.task), a.bank, a.robot, progress)
    return o.Result(errors, {"photos": len(errors.size), "rms": errors.size.tolist()}, model=errors)
