"""`embodiedreamer standin record`."""

import numpy as np

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.motions import MOTIONS

LOG = {  # options of a single arm's log
    "hz": ("HZ", "samples per second (default: 100)", o.number(float, 1.0, 1e4)),
    "seconds": ("S", "length of each recording (default: 4)", o.number(float, 0.1, 3600.0)),
    "noise": ("RAD", "standard deviation of the position noise (default: 4e-4)", o.POSITIVE),
    "quantum": ("RAD", "encoder step (default: 2 pi / 4096)", o.POSITIVE),
    "jitter": ("S", "standard deviation of the time stamps (default: none)", o.POSITIVE),
}


@o.verb(
    o.option("--effect", "E", "effects, separated by commas; none, or any for a random one", "none"),
    o.option("--arm", "ARM", "arm6, arm6b, arm7 or aloha", "arm6"),
    o.option("--side", None, "arm of the ALOHA pair", "left", choices=("left", "right")),
    o.option("--strength", None, "strength of the effect", "plain", choices=("faint", "plain", "strong")),
    o.SEED,
    *(o.option(f"--{name}", metavar, f"single arm: {text}", None, kind) for name, (metavar, text, kind) in LOG.items()),
    o.option("--motion", None, "single arm: motion of all recordings", choices=tuple(MOTIONS)),
    o.option("--no-command", None, "single arm: log only position and effort"),
    o.QUIET,
    o.out_folder("output folder: model.json, train/, test/ and truth.json"),
)
def run(a, progress):
    """Record logs of a simulated robot with a hidden effect; the ground truth is written to a separate file."""
    from embodiedreamer_gym.effects import CATALOGUE
    from embodiedreamer_gym.io.files import atomic_folder, write_json
    from embodiedreamer_gym.standin.cases import aloha_case, draw_case

    with atomic_folder(a.out) as part:
        rng = np.random.default_rng(a.seed)
        effects = [str(rng.choice(sorted(CATALOGUE)))] if a.effect == "any" else a.effect.split(",")
        effect = None if a.effect == "none" else effects[0] if len(effects) == 1 else effects
        log = {name: getattr(a, name) for name in LOG if getattr(a, name) is not None}
        log |= {"learnt": (a.motion,) * 2, "held_out": (a.motion,) * 2} if a.motion else {}
        log |= {"with_command": False} if a.no_command else {}
        if a.arm == "aloha" and (log or len(effects) > 1):
            raise EmbodieDreamerError(
                "the ALOHA pair logs teleoperation at 30 Hz with one effect; leave the options out."
            )
        case = (
            aloha_case(effects[0] if effect else None, a.side, rng, a.strength) if a.arm == "aloha"
            else draw_case(effect, a.arm, rng, a.strength, **log)
        )  # fmt: skip
        progress(f"{len(case.train) + len(case.test)} recordings")
        model = case.write(part)
        write_json(case.truth, part / "truth.json")
    text = f"{len(case.train)} recordings for training, {len(case.test)} held out; ground truth: {a.out / 'truth.json'}\n\n"
    text += f"embodiedreamer diagnose --model {a.out / model.name} --train {a.out / 'train'} --test {a.out / 'test'}"
    return text + (" --hz 30" if a.arm == "aloha" else "")
