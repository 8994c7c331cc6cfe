"""`embodiedreamer robots`."""

from embodiedreamer_gym.cli import options as o


@o.verb(o.JSON)
def run(a, progress):
    """List the built-in robots: joints, arms, source."""
    from embodiedreamer_gym.robot import RobotModel, built_in_robots
    from embodiedreamer_gym.robot.files import ASSETS

    rows, sources = [], (ASSETS / "SOURCES.md").read_text(encoding="utf-8").splitlines()
    for name in built_in_robots():
        model = RobotModel.load(name)
        what, source = next(line.split("|")[2:4] for line in sources if f"{name}.json" in line)
        arms = max(len(model.end_effectors), 1)
        rows.append({"name": name, "joints": model.n, "arms": arms, "what": what.strip(), "source": source.strip()})
    table = ({key: key for key in rows[0]}, *rows)
    lines = ["{name:<8}{joints:<8}{arms:<6}{what:<42}{source}".format(**row) for row in table]
    return o.Result("\n".join(lines), rows)
