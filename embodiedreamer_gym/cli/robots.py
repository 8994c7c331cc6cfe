"""`embodiedreamer robots`."""

from embodiedreamer_gym.cli.options import JSON
from embodiedreamer_gym.io.files import check_outputs, write_json

TEXT = "list the built-in robots: joints, arms, source"
OPTIONS = (JSON,)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.robot import RobotModel, built_in_robots
    from embodiedreamer_gym.robot.files import ASSETS

    check_outputs(a.json)
    rows, sources = [], (ASSETS / "SOURCES.md").read_text(encoding="utf-8").splitlines()
    for name in built_in_robots():
        model = RobotModel.load(name)
        what, source = next(line.split("|")[2:4] for line in sources if f"{name}.json" in line)
        arms = max(len(model.end_effectors), 1)
        rows.append({"name": name, "joints": model.n, "arms": arms, "what": what.strip(), "source": source.strip()})
    progress.close()
    for row in ({key: key for key in rows[0]}, *rows):
        print("{name:<8}{joints:<8}{arms:<6}{what:<42}{source}".format(**row))
    if a.json:
        write_json(rows, a.json)
