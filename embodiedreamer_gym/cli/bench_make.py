"""`embodiedreamer bench make`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o

TIERS = "none,single,subset,pair,outside"
OBSERVATIONS = "position,effort,no_command,teleoperation"


@o.verb(
    o.option("--cases", "N", "number of cases", 20, o.number(int, 1, 9999)),
    o.option("--tiers", "T,...", "kinds of hidden effects, used in turn", TIERS),
    o.option("--observations", "O,...", "recorded signals, used in turn", OBSERVATIONS),
    o.option("--real", "DIR", "further cases of real robots: folders with model.json, train/ and test/", [], nargs="+"),
    o.option("--seconds", "S", "length of each recording", 6.0, o.number(float, 1.0, 60.0)),
    o.SEED,
    o.JOBS,
    o.QUIET,
    o.out_folder("output folder of the cases; new or empty"),
    o.option(
        "--truth", "DIR", "output folder of the ground truth; new or empty (default: OUT-truth)", None, o.output_folder
    ),
)
def run(a, progress):
    """Create benchmark cases with hidden effects; the ground truth is written to a separate folder."""
    from embodiedreamer_gym.bench.cases import make_cases

    truth = a.truth or a.out.with_name(f"{a.out.name}-truth")
    tiers, observations = ([one.strip() for one in text.split(",")] for text in (a.tiers, a.observations))
    real = [Path(text) for text in a.real]
    digest = make_cases(a.out, truth, a.cases, a.seed, tiers, observations, real, a.seconds, a.jobs, progress)
    text = f"{a.cases + len(real)} cases in {a.out}; truth in {truth}, SHA-256 {digest}\n\n"
    return text + f"embodiedreamer bench run diagnose coulomb --cases {a.out} --out answers.jsonl"
