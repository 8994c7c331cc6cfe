"""LeRobot evaluates an ACT checkpoint in these environments; run it in LeRobot's environment, with this package.

python lerobot_evaluates.py CHECKPOINT OUT.json [--episodes 2] [--steps 60]

The environments come from examples/lerobot/env.py, imported and called as LeRobot does for a repository of its hub.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from types import SimpleNamespace

from lerobot.envs.factory import make_env_pre_post_processors
from lerobot.envs.utils import _call_make_env, _import_hub_module, _normalize_hub_result
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors
from lerobot.scripts.lerobot_eval import eval_policy_all

FILE = Path(__file__).parents[1] / "examples" / "lerobot" / "env.py"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int, default=2)
    parser.add_argument("--steps", type=int, default=60)
    a = parser.parse_args()
    hub = _import_hub_module(str(FILE), "somebody/embodiedreamer")
    hub.ARGUMENTS |= {"cameras": ("head",), "image_size": (64, 48), "max_episode_steps": a.steps}
    cfg = SimpleNamespace(type="embodiedreamer", task="PutCupOnMat", fps=30)
    envs = _normalize_hub_result(_call_make_env(hub, a.episodes, False, cfg))
    policy = ACTPolicy.from_pretrained(a.checkpoint)
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(a.checkpoint))
    env_before, env_after = make_env_pre_post_processors(env_cfg=cfg, policy_cfg=policy.config)
    found = eval_policy_all(envs, policy, env_before, env_after, before, after, a.episodes, start_seed=0)
    a.out.write_text(json.dumps({key: found["overall"][key] for key in ("avg_sum_reward", "pc_success", "n_episodes")}))


if __name__ == "__main__":
    main()
