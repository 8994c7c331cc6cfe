"""`embodiedreamer effects`."""

from embodiedreamer_gym.cli.options import JSON, option
from embodiedreamer_gym.io.files import check_outputs, write_json

TEXT = "list the physical effects: symptom, parameters with units, what reveals each, what it is confused with"
OPTIONS = (option("--effects", "FILE.py", "your own effects too; the file is executed"), JSON)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.effects import CATALOGUE, load_effects

    check_outputs(a.json)
    rows = []
    for name, kind in (load_effects(a.effects) if a.effects else CATALOGUE).items():
        units = ", ".join(f"{one.name} ({one.unit})" for one in kind.parameters)
        rows.append({"name": name, "symptom": kind.symptom, "parameters": units, "revealed by": kind.reveals,
                     "confused with": ", ".join(kind.confused_with) or "-"})  # fmt: skip
    progress.close()
    for row in rows:
        print("\n  ".join([row["name"], *(f"{key + ':':<15}{row[key]}" for key in list(row)[1:])]))
    if a.json:
        write_json(rows, a.json)
