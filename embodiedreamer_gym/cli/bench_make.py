"""`embodiedreamer bench make`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o

TIERS = "none,single,subset,pair,outside"
OBSERVATIONS = "position,effort,no_command,teleoperation"


@o.verb(
    o.option("--cases", "N", "how many", 20, o.number(int, 1, 9999)),
    o.option("--tiers", "T,...", "kinds of hidden causes, taken in turn", TIERS),
    o.option("--observations", "O,...", "recorded signals, taken in turn", OBSERVATIONS),
    o.option(
        "--real", "DIR", "folders with model.json, train/ and test/ of real robots, as further cases", [], nargs="+"
    ),
    o.option("--seconds", "S", "of each recording", 6.0, o.number(float, 1.0, 60.0)),
    o.SEED,
    o.JOBS,
    o.QUIET,
    o.out_folder("cases; new or empty"),
    o.option("--truth", "DIR", "ground truth of the cases; new or empty (default: OUT-truth)", None, o.output_folder),
)
def run(a, progress):
    """Draw hidden cases for any tool, the truth in a folder of its own."""
    from embodiedreamer_gym.bench.cases import make_cases

    truth = a.truth or a.out.with_name(f"{a.out.name}-truth")
    tiers, observations = ([one.strip() for one in text.split(",")] for text in (a.tiers, a.observations))
    real = [Path(text) for text in a.real]
    digest = make_cases(a.out, truth, a.cases, a.seed, tiers, observations, real, a.seconds, a.jobs, progress)
    text = f"{a.cases + len(real)} cases in {a.out}; truth in {truth}, SHA-256 {digest}\n\n"
    return text + f"embodiedreamer bench run diagnose coulomb --cases {a.out} --out answers.jsonl"
