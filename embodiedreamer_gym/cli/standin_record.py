"""`embodiedreamer standin record`."""

import numpy as np

from embodiedreamer_gym.cli.options import POSITIVE, SEED, option, out_folder, real
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.motions import MOTIONS

TEXT = "recordings of a stand-in robot with a hidden effect, the ground truth in a file of its own"
LOG = {  # of a single arm
    "hz": ("HZ", "samples per second (default 100)", real(1.0, 1e4)),
    "seconds": ("S", "of each recording (default 4)", real(0.1, 3600.0)),
    "noise": ("RAD", "sd of the position sensor (default 4e-4)", POSITIVE),
    "quantum": ("RAD", "step of the encoder (default 2 pi / 4096)", POSITIVE),
    "jitter": ("S", "sd of the time stamps (default none)", POSITIVE),
}
OPTIONS = (
    option("--effect", "E", "effects, with commas; none, or any (drawn)", "none"),
    option("--arm", "ARM", "arm6, arm6b, arm7 or aloha", "arm6"),
    option("--side", None, "of the ALOHA pair (default: %(default)s)", "left", choices=("left", "right")),
    option("--strength", None, "of the effect (default: %(default)s)", "plain", choices=("faint", "plain", "strong")),
    SEED,
    *(option(f"--{name}", metavar, f"single arm: {text}", None, kind) for name, (metavar, text, kind) in LOG.items()),
    option("--motion", None, "single arm: of all recordings", choices=tuple(MOTIONS)),
    option("--no-command", None, "single arm: log position and effort alone"),
    out_folder("model.json, train/, test/ and truth.json"),
)


def run(a, progress) -> None:
    """Run the verb."""
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
        if a.arm == "aloha":
            case = aloha_case(effects[0] if effect else None, a.side, rng, a.strength)
        else:
            case = draw_case(effect, a.arm, rng, a.strength, **log)
        progress(f"{len(case.train) + len(case.test)} recordings")
        model = case.write(part)
        write_json(case.truth, part / "truth.json")
    progress.close()
    print(f"{len(case.train)} recordings to learn from, {len(case.test)} held out; "
          f"the ground truth is in {a.out / 'truth.json'}\n")  # fmt: skip
    hz = " --hz 30" if a.arm == "aloha" else ""
    print(f"embodiedreamer diagnose --model {a.out / model.name} --train {a.out / 'train'} --test {a.out / 'test'}{hz}")
